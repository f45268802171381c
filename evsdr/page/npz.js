// Reading a maps.npz, a ZIP archive of NumPy arrays, and the contents of another page.
async function openOther(file) {
  if (/\.npz$/i.test(file.name)) return openMaps(await readNpz(await file.arrayBuffer()), file.name);
  // Not parsed as a page: the policy of this one would complain of that one's style. Its JSON holds no "<".
  const found = /id="evsdr-report">([^<]+)</.exec(await file.text());
  if (!found) throw new Error("it is no report.html of evsdr");
  const contents = JSON.parse(found[1]);
  return openReport(contents, `${contents.title} (${file.name})`);
}

async function readNpz(buffer) {
  const view = new DataView(buffer), arrays = {};
  let end = buffer.byteLength - 22;
  while (end >= 0 && view.getUint32(end, true) !== 0x06054b50) end--;
  if (end < 0) throw new Error("it is no .npz");
  const count = view.getUint16(end + 10, true);
  for (let k = 0, at = view.getUint32(end + 16, true); k < count; k++) {
    const [method, size, nameSize, more, note, start] = [
      view.getUint16(at + 10, true), view.getUint32(at + 20, true), view.getUint16(at + 28, true),
      view.getUint16(at + 30, true), view.getUint16(at + 32, true), view.getUint32(at + 42, true),
    ];
    const name = new TextDecoder().decode(new Uint8Array(buffer, at + 46, nameSize));
    const first = start + 30 + view.getUint16(start + 26, true) + view.getUint16(start + 28, true);
    const bytes = new Uint8Array(buffer, first, size);
    arrays[name.replace(/\.npy$/, "")] = readNpy(method ? await inflate(bytes, "deflate-raw") : bytes.slice());
    at += 46 + nameSize + more + note;
  }
  return arrays;
}

function readNpy(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), long = bytes[6] > 1;
  const start = (long ? 12 : 10) + (long ? view.getUint32(8, true) : view.getUint16(8, true));
  const head = new TextDecoder().decode(bytes.subarray(0, start));
  const kind = /'descr': '([^']+)'/.exec(head)?.[1], shape = /'shape': \(([^)]*)\)/.exec(head)?.[1];
  const types = { "<f4": Float32Array, "<f8": Float64Array, "|b1": Uint8Array };
  if (!types[kind] || /'fortran_order': True/.test(head)) throw new Error(`an array of it is ${kind}`);
  return { shape: shape.split(",").filter((n) => n.trim()).map(Number), values: new types[kind](bytes.slice(start).buffer) };
}

// The maps of a maps.npz as `openReport` gives those of a page.
function openMaps(arrays, name) {
  for (const key of ["normal", "reflectance", "mask", "normal_sigma_deg", "reflectance_sigma", "band_wavelength_nm"])
    if (!arrays[key]) throw new Error(`it has no ${key}`);
  const [height, width] = arrays.mask.shape, scaled = (arrays.mask_reflectance ?? arrays.mask).values;
  const state = Uint8Array.from(arrays.mask.values, (known, at) => (known ? SOLVED | KNOWN : 0) | (scaled[at] ? SOLVED | SCALED : 0));
  const has = (key) => ["normal", "reflectance", "normal_sigma_deg", "reflectance_sigma"].includes(key);
  const fit = fitOf({ name, height, width, state, has, wavelength_nm: [...arrays.band_wavelength_nm.values], left_out: [] });
  const planes = (key) => {
    const n_channel = arrays[key].values.length / (height * width), out = new Float32Array(n_channel * fit.n);
    for (let c = 0; c < n_channel; c++)
      fit.pixel.forEach((at, i) => (out[c * fit.n + i] = arrays[key].values[at * n_channel + c]));
    return out;
  };
  return { ...fit, layer: async (key) => (has(key) ? planes(key) : null) };
}
