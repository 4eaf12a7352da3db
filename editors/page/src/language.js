// Highlighting: words, numbers, texts and comments; indentation of new lines. The language server knows the rest.

import { HighlightStyle, indentService, StreamLanguage, syntaxHighlighting } from "@codemirror/language";
import { tags } from "@lezer/highlight";

/** @typedef {{block: "" | "*\/" | '"""' | "'''"}} Inside */

/** Read on to the end of a text of several lines.
 * @param {import("@codemirror/language").StringStream} stream @param {Inside} inside */
function readBlock(stream, inside) {
  const kind = inside.block === "*/" ? "comment" : "string";
  while (!stream.eol()) {
    if (stream.match(inside.block)) {
      inside.block = "";
      break;
    }
    stream.next();
  }
  return kind;
}

/** @param {boolean} isToml @param {Set<string>} keywords */
const tokenizer = (isToml, keywords) => ({
  startState: () => /** @type {Inside} */ ({ block: "" }),
  token(/** @type {import("@codemirror/language").StringStream} */ stream, /** @type {Inside} */ inside) {
    if (inside.block) return readBlock(stream, inside);
    if (stream.eatSpace()) return null;
    if (stream.match(isToml ? /#.*/ : /\/\/.*/)) return "comment";
    for (const [start, end] of isToml ? [['"""', '"""'], ["'''", "'''"]] : [["/*", "*/"], ['"""', '"""']]) {
      if (stream.match(start)) {
        inside.block = /** @type {Inside["block"]} */ (end);
        return readBlock(stream, inside);
      }
    }
    if (stream.match(/"(\\.|[^"\\])*"?/) || stream.match(/'[^']*'/)) return "string";
    if (isToml && stream.sol() && stream.match(/\[.*?\]/)) return "heading";
    if (stream.match(/@\w+/)) return "meta";
    if (stream.match(/\d[\d_]*(\.\d+)?([eE][-+]?\d+)?/)) return "number";
    const word = stream.match(/[A-Za-z_]\w*/);
    if (Array.isArray(word)) {
      if (isToml) return stream.match(/\s*=/, false) ? "propertyName" : /^(true|false)$/.test(word[0]) ? "keyword" : null;
      if (keywords.has(word[0])) return "keyword";
      return /^[A-Z]/.test(word[0]) ? "typeName" : null;
    }
    stream.next();
    return null;
  },
  languageData: { commentTokens: isToml ? { line: "#" } : { line: "//", block: { open: "/*", close: "*/" } } },
});

/** Return the highlighting of a language. @param {string} language */
export const languageOf = (language) => StreamLanguage.define(tokenizer(language === "toml", new Set(GRAMMAR_KEYWORDS[language])));

/** A new line is as far in as the line before it, or one unit more behind an open bracket. */
export const indentation = indentService.of((context, place) => {
  if (context.simulatedBreak === null) return null; // the line exists already: leave it to Format
  const line = context.state.doc.lineAt(place);
  const before = line.text.slice(0, place - line.from);
  const isInside = /[([{]\s*$/.test(before) && !/^\s*[)\]}]/.test(context.textAfterPos(place));
  return before.length - before.trimStart().length + (isInside ? context.unit : 0);
});

const style = (/** @type {string} */ name) => `var(--code-${name})`;

export const highlighting = syntaxHighlighting(HighlightStyle.define([
  { tag: tags.keyword, color: style("keyword"), fontWeight: "600" },
  { tag: tags.comment, color: style("comment"), fontStyle: "italic" },
  { tag: tags.string, color: style("string") },
  { tag: tags.number, color: style("number") },
  { tag: tags.typeName, color: style("type") },
  { tag: [tags.meta, tags.heading, tags.propertyName], color: style("meta") },
]));
