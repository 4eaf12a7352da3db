// Tokenise a text as VS Code does, with the grammars of the build.

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
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

/** Return the TextMate grammar of a language. */
export const grammarOf = (language) => registry.loadGrammar(`source.envgraph.${language}`);

/** Return the kind of each character of a text, "" for white space between tokens. */
export function kindsOf(grammar, text) {
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
