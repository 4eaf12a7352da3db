/**
 * What the page and its server say to each other, as data. docs/architecture/page.md describes the requests.
 *
 * @typedef {{line: number, character: number}} Position lines and characters from 0
 * @typedef {{start: Position, end: Position}} Range
 * @typedef {{uri: string, range: Range}} Location
 * @typedef {{uri: string, name: string, language: string, text: string}} TextFile
 * @typedef {{name: string, type: string}} Parameter
 * @typedef {{name: string, uri: string, parameters: Parameter[], doc?: string, kind?: string}} Definition
 * @typedef {{name: string, actions: {name: string, keys?: string[]}[]}} EnvironmentInfo
 * @typedef {{
 *   title: string, rootUri?: string, writable: boolean, files: TextFile[], models: {name: string, uri: string}[],
 *   patterns: Definition[], rules: Definition[], environments: EnvironmentInfo[], members: (string|{name: string})[],
 *   version: number, errors: number}} Domain
 * @typedef {{
 *   kind: string, svg?: string, dot?: string, text?: string, objects: {id: number, name: string, class: string}[],
 *   canUndo: boolean, canRedo: boolean, steps: string[], model?: string|null, note?: string}} Picture
 * @typedef {{index: number, values: Record<string, string>, objects: number[]}} Match
 * @typedef {{count: number, more: boolean, matches: Match[], version: number}} Matches
 * @typedef {{
 *   solvable?: boolean|null, shortest?: number|null, optimal?: number|null, randomWalk?: number|null, states?: number|null,
 *   text?: string}} Certificate
 * @typedef {{name: string, title?: string, svg?: string, certificate?: Certificate|null, parent?: string|null}} Member
 * @typedef {{
 *   range: Range, severity?: number, message: string, code?: string|number, source?: string}} Diagnostic
 */
export {};
