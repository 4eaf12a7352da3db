/** The keywords of all languages, written by build.mjs. */
declare const GRAMMAR_KEYWORDS: string[];
