// Links that hold a domain: its texts as JSON, compressed, in the part of the address that no server sees.

const MOST = 20_000_000; // bytes of all files in a link: a small link may hold many more, which would fill the memory

/** @param {Uint8Array} bytes @param {CompressionStream|DecompressionStream} step */
async function throughStream(bytes, step) {
  let size = 0;
  const limit = new TransformStream({
    transform(chunk, controller) {
      size += chunk.length;
      if (size > MOST) throw new RangeError("too long");
      controller.enqueue(chunk);
    },
  });
  const stream = new Blob([/** @type {any} */ (bytes)]).stream().pipeThrough(/** @type {any} */ (step)).pipeThrough(limit);
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Return the address of this page with the files in it.
 * @param {{name: string, text: string}[]} files */
export async function linkWith(files) {
  const bytes = new TextEncoder().encode(JSON.stringify({ files: files.map(({ name, text }) => ({ name, text })) }));
  const packed = await throughStream(bytes, new CompressionStream("deflate-raw"));
  const letters = btoa(Array.from(packed, (byte) => String.fromCharCode(byte)).join(""));
  const link = new URL(location.href);
  link.search = ""; // the texts take the place of a domain that it names
  link.hash = `domain=${letters.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "")}`;
  return link.href;
}

/** Return the files in the address of this page, or null if it holds none.
 * @returns {Promise<{name: string, text: string}[] | null>} */
export async function filesOfLink() {
  const letters = /^#domain=([A-Za-z0-9_-]+)$/.exec(location.hash)?.[1];
  if (!letters) return null;
  try {
    const packed = Uint8Array.from(atob(letters.replaceAll("-", "+").replaceAll("_", "/")), (letter) => letter.charCodeAt(0));
    const { files } = JSON.parse(new TextDecoder().decode(await throughStream(packed, new DecompressionStream("deflate-raw"))));
    return files.map((/** @type {any} */ file) => ({ name: String(file.name), text: String(file.text) }));
  } catch (error) {
    if (error instanceof RangeError) throw new Error("The files in the address are longer than 20 MB, which is too long for a link.");
    throw new Error("The files in the address cannot be read. Perhaps the link was cut: copy all of it.");
  }
}
