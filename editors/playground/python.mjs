// Starts Python with envgraph in it, for the worker and for the build.

import { loadPyodide } from "./pyodide/pyodide.mjs";
import createModule from "./pyodide/pyodide.asm.mjs";

const HOME = "/envgraph";

/** Return the content of a file that may be compressed; some servers decompress it.
 * @param {Uint8Array} bytes */
export async function inflate(bytes) {
  if (bytes[0] !== 0x1f || bytes[1] !== 0x8b) return bytes;
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Return Python in the state in which the build stored it, with everything imported.
 * @param {Uint8Array} memory */
function restorePython(memory) {
  const createPyodideModule = async (settings) => {
    const module = await createModule(settings);
    while (module.HEAP8.length < memory.length) module._malloc(memory.length); // Pyodide copies it without enlarging the heap
    return module;
  };
  return loadPyodide({ _loadSnapshot: memory, createPyodideModule });
}

/** Write the files of envgraph where Python finds them.
 * @param {Uint8Array} bytes */
function writeFiles(python, bytes) {
  const files = Object.entries(JSON.parse(new TextDecoder().decode(bytes))).map(([path, text]) => [`${HOME}/${path}`, text]);
  for (const folder of new Set(files.map(([path]) => path.replace(/\/[^/]*$/, "")))) python.FS.mkdirTree(folder);
  const encoder = new TextEncoder(); // faster than that of `writeFile`
  for (const [path, text] of files) python.FS.writeFile(path, encoder.encode(text));
}

/** Start Python and execute `start.py`. This takes some seconds.
 * @param {(path: string) => Promise<Uint8Array>} load @param {object} [options] of `loadPyodide` */
export async function startNewPython(load, options) {
  const python = await loadPyodide(options);
  writeFiles(python, await load("envgraph.bin"));
  python.runPython(`import sys; sys.path.append("${HOME}")`);
  python.runPython(new TextDecoder().decode(await load("start.py")));
  return python;
}

/** Return a Python that has executed `start.py`: restore its stored memory or, if this fails, start it.
 * @param {(path: string) => Promise<Uint8Array>} load reads a file beside this one */
export async function startPython(load) {
  const files = load("envgraph.bin"); // for modules that are not imported yet
  try {
    const python = await restorePython(await load("memory.bin"));
    writeFiles(python, await files);
    return python;
  } catch (error) {
    console.warn("The stored memory could not be restored, so Python is started.", error);
    return startNewPython(load);
  }
}
