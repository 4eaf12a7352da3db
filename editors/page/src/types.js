/**
 * The data that the page and its server exchange. docs/architecture/page.md describes the requests.
 *
 * @typedef {{line: number, character: number}} Position lines and characters from 0
 * @typedef {{start: Position, end: Position}} Range
 * @typedef {{uri: string, range: Range}} Location
 * @typedef {{uri: string, name: string, language: string, text: string}} TextFile
 * @typedef {{name: string, type: string}} Parameter
 * @typedef {{name: string, uri: string, parameters: Parameter[], doc?: string, kind?: string}} Definition
 * @typedef {{
 *   title: string, rootUri?: string, writable: boolean, files: TextFile[], models: {name: string, uri: string}[],
 *   patterns: Definition[], rules: Definition[], environments: {name: string}[], members: {name: string}[],
 *   version: number, errors: number}} Domain
 * @typedef {{
 *   kind: string, svg?: string, dot?: string, text?: string, objects: {id: number, name: string, class: string}[],
 *   canUndo: boolean, canRedo: boolean, steps: string[], model?: string|null, note?: string}} Picture
 * @typedef {{index: number, values: Record<string, string>, objects: number[]}} Match
 * @typedef {{count: number, more: boolean, matches: Match[], version: number}} Matches
 * @typedef {{name: string, title?: string, svg?: string, certificate?: {text: string}|null}} Member
 * @typedef {{
 *   range: Range, severity?: number, message: string, code?: string|number, source?: string}} Diagnostic
 */
export {};
