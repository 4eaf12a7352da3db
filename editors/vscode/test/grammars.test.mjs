// The TextMate grammars colour every token of bundled files and of the documentation as the parser reads it.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { join } from "node:path";
import { test } from "node:test";
import { grammarOf, kindsOf } from "./tokenizer.mjs";

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
const output = execFileSync(python, [join(import.meta.dirname, "expected_tokens.py")], { maxBuffer: 1 << 28 });

for (const { place, language, text, tokens } of JSON.parse(output)) {
    test(place, async () => {
        const grammar = await grammarOf(language);
        assert.deepEqual(differences(kindsOf(grammar, text), text, tokens), []);
    });
}

test("there are texts of all languages", () => {
    const texts = JSON.parse(output);
    assert.equal(new Set(texts.map((one) => one.language)).size, 5);
    assert.ok(texts.flatMap((one) => one.tokens).length > 10_000);
});
