/** The keywords of each language, written by build.mjs. */
declare const GRAMMAR_KEYWORDS: Record<string, string[]>;
