// The grammar of family files: VS Code has none for TOML.

import assert from "node:assert/strict";
import { test } from "node:test";
import { grammarOf, kindsOf } from "./tokenizer.mjs";

const grammar = await grammarOf("toml");

/** Return the pieces of a line that are coloured, each with its kind. */
function pieces(line) {
    const kinds = kindsOf(grammar, line);
    const found = [];
    for (const [index, letter] of [...line].entries()) {
        if (kinds[index] && kinds[index] === kinds[index - 1]) {
            found.at(-1)[0] += letter;
        } else if (kinds[index]) {
            found.push([letter, kinds[index]]);
        }
    }
    return found;
}

test("tables, keys, values and comments have kinds of their own", () => {
    assert.deepEqual(pieces("[measures.plan]  # a table"), [
        ["[", "sign"], ["measures.plan", "name"], ["]", "sign"], ["# a table", "comment"],
    ]);
    assert.deepEqual(pieces("range = [1, -2.5e3, true]"), [
        ["range", "name"], ["=", "sign"], ["[", "sign"], ["1", "number"], [",", "sign"], ["-2.5e3", "number"], [",", "sign"],
        ["true", "keyword"], ["]", "sign"],
    ]);
    assert.deepEqual(pieces(`of = "a \\" # b"`), [["of", "name"], ["=", "sign"], [`"a \\" # b"`, "string"]]);
});

test("a string of three quotes spans lines, other strings end with their line", () => {
    const [first, second] = ['of = """x', 'y"""'];
    assert.deepEqual(new Set(kindsOf(grammar, `${first}\n${second}`).slice(first.length + 1, -1)), new Set(["string"]));
    const open = 'of = "x';
    assert.equal(kindsOf(grammar, `${open}\nseed = 1`)[open.length + 1], "name");
});
