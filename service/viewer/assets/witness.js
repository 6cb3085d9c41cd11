// The checker of witnesses as WebAssembly: it reads a file and writes a line, and asks for no more.
const NO_SUCH_FILE = 8, NO_PLACES = 70;
async function checkerModule() {
  const packed = Uint8Array.from(atob(data.checker), (letter) => letter.charCodeAt(0));
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return WebAssembly.compile(await new Response(unpacked).arrayBuffer());
}
async function runChecker(module, file) {
  const words = new TextEncoder().encode("armwright-check\0-\0"), decoder = new TextDecoder();
  let memory = null, read = 0, said = "", code = null;
  const set = (at, value) => new DataView(memory.buffer).setUint32(at, value, true);
  const parts = (list, count) => Array.from({ length: count }, (_, i) => {
    const numbers = new DataView(memory.buffer, list + 8 * i, 8);
    return new Uint8Array(memory.buffer, numbers.getUint32(0, true), numbers.getUint32(4, true));
  });
  const system = {
    args_sizes_get(count, size) { set(count, 2); set(size, words.length); return 0; },
    args_get(list, text) {
      new Uint8Array(memory.buffer).set(words, text);
      set(list, text); set(list + 4, text + 16);
      return 0;
    },
    fd_read(_, list, count, done) {
      const before = read;
      for (const part of parts(list, count)) {
        const next = file.subarray(read, read + part.length);
        part.set(next); read += next.length;
      }
      set(done, read - before);
      return 0;
    },
    fd_write(_, list, count, done) {
      let written = 0;
      for (const part of parts(list, count)) { said += decoder.decode(part.slice()); written += part.length; }
      set(done, written);
      return 0;
    },
    fd_fdstat_get(_, at) { new Uint8Array(memory.buffer, at, 24).fill(0); return 0; },
    fd_fdstat_set_flags: () => 0, fd_close: () => 0, fd_seek: () => NO_PLACES,
    fd_prestat_get: () => NO_SUCH_FILE, fd_prestat_dir_name: () => NO_SUCH_FILE, path_open: () => NO_SUCH_FILE,
    proc_exit(value) { code = value; throw new Error("the program has ended"); },
  };
  const program = await WebAssembly.instantiate(module, { wasi_snapshot_preview1: system });
  memory = program.exports.memory;
  // It ends by an exception, whatever else it may be: without a code it has proved nothing.
  const begun = performance.now();
  try { program.exports._start(); } catch (error) { if (code === null) said = `rejected: ${error.message}`; }
  return { code, said: said.trim(), took: performance.now() - begun };
}
async function checkWitnesses() {
  if (!(data.witnesses || []).length) return;
  const item = Object.assign(document.createElement("li"), { id: "checked", textContent: "Being checked in your browser …" });
  byId("words").append(item);
  try {
    const module = await checkerModule(), results = [];
    for (const text of data.witnesses) {
      const file = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
      results.push(await runChecker(module, file));
    }
    // What the page does meanwhile, as to draw itself, is not part of it.
    const took = `${Math.max(1, Math.round(results.reduce((sum, { took }) => sum + took, 0)))} ms`;
    const wrong = results.findIndex(({ code }) => code !== 0 && code !== 2);
    const many = results.length > 1 ? ` (${results.length} parts)` : "";
    item.dataset.codes = results.map(({ code }) => code).join(" ");
    item.textContent = wrong < 0
      ? `Checked here, in your browser, in ${took}${many}: ${results.map(({ said }) => said.replace("accepted: ", "").replaceAll("\n", "; ")).join(". ")}`
      : `✗ Your browser can't follow the proof${many}: ${results[wrong].said}`;
  } catch (error) {
    item.textContent = `Not checked in your browser: ${error.message}`;
  }
}
