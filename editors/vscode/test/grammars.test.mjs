// The TextMate grammars colour every token of bundled files and of the documentation as the parser reads it.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { test } from "node:test";
import oniguruma from "vscode-oniguruma";
import textmate from "vscode-textmate";

const here = new URL(".", import.meta.url);
const wasm = createRequire(import.meta.url).resolve("vscode-oniguruma/release/onig.wasm");
await oniguruma.loadWASM(readFileSync(wasm));

const registry = new textmate.Registry({
    onigLib: Promise.resolve({
        createOnigScanner: (patterns) => new oniguruma.OnigScanner(patterns),
        createOnigString: (text) => new oniguruma.OnigString(text),
    }),
    loadGrammar: async (scope) => {
        const path = new URL(`../build/syntaxes/${scope.split(".").at(-1)}.tmLanguage.json`, here);
        return textmate.parseRawGrammar(readFileSync(path, "utf8"), "grammar.json");
    },
});

const KINDS = [
    [/ comment\./, "comment"],
    [/ string\./, "string"],
    [/ constant\.numeric\./, "number"],
    [/ (storage\.type|keyword\.control|constant\.language)\./, "keyword"],
    [/ (variable|entity)\./, "name"],
    [/ (punctuation|keyword\.operator)\./, "sign"],
];

/** Return the kind of each character of a text, "" for white space between tokens. */
function kindsOf(grammar, text) {
    const kinds = [];
    let state = textmate.INITIAL;
    for (const line of text.split("\n")) {
        const result = grammar.tokenizeLine(line, state);
        state = result.ruleStack;
        for (const token of result.tokens) {
            const scopes = token.scopes.join(" ");
            const kind = KINDS.find(([pattern]) => pattern.test(scopes))?.[1] ?? "";
            kinds.push(...Array(Math.min(token.endIndex, line.length) - token.startIndex).fill(kind));
        }
        kinds.push(""); // the line end, which belongs to no token
    }
    return kinds;
}

/** Return a line for each token and each gap between tokens that has another kind than the parser says. */
function differences(kinds, text, tokens) {
    const found = [];
    const expect = (start, end, kind) => {
        const actual = new Set(kinds.slice(start, end).filter((_, index) => text[start + index] !== "\n"));
        if ([...actual].some((one) => one !== kind)) {
            const line = text.slice(0, start).split("\n").length;
            found.push(`line ${line}: \`${text.slice(start, end)}\` is ${kind || "no token"}, not ${[...actual]}`);
        }
    };
    let end = 0;
    for (const [start, stop, kind] of tokens) {
        expect(end, start, "");
        expect(start, stop, kind);
        end = stop;
    }
    return found;
}

const python = process.env.PYTHON ?? "python3";
const output = execFileSync(python, [new URL("expected_tokens.py", here).pathname], { maxBuffer: 1 << 28 });

for (const { place, language, text, tokens } of JSON.parse(output)) {
    test(place, async () => {
        const grammar = await registry.loadGrammar(`source.envgraph.${language}`);
        assert.deepEqual(differences(kindsOf(grammar, text), text, tokens), []);
    });
}

test("there are texts of all languages", () => {
    const texts = JSON.parse(output);
    assert.equal(new Set(texts.map((one) => one.language)).size, 5);
    assert.ok(texts.flatMap((one) => one.tokens).length > 10_000);
});
