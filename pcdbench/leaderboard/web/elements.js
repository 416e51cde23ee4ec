// Makes elements, formats numbers, reads packed arrays. Text only ever becomes text nodes: no name can become markup.

const SVG = "http://www.w3.org/2000/svg";
const el = (name, attributes, ...children) => filled(document.createElement(name), attributes, children);
const svg = (name, attributes, ...children) => filled(document.createElementNS(SVG, name), attributes, children);
/** A name of unknown direction: it must not turn what stands beside it around. Lines may break after its underscores. */
const isolated = (text) =>
  el("bdi", {}, (text.match(/[^_]*_|[^_]+/g) ?? []).flatMap((part, i) => (i ? [el("wbr"), part] : [part])));

function filled(element, attributes = {}, children = []) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (typeof value === "function") element.addEventListener(name, value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(
    ...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false),
  );
  return element;
}

/** As tables of `pcdbench results` have it: `3.9e-4`, `0.893`, `12.4`; metres with three decimals. */
function number(value, unit = "") {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (unit === "m" && size >= 0.0005) return value.toFixed(3);
  if (size < 0.01) return tidy(value.toExponential(1));
  return size < 10 ? value.toFixed(3) : size < 1000 ? value.toFixed(1) : Math.round(value).toLocaleString("en");
}

const tidy = (text) => text.replace("e+", "e").replace("-", "−").replace(/e-/, "e−");
const percent = (share, digits = 0) => `${(100 * share).toFixed(digits)} %`;
const counted = (count, noun) => `${count.toLocaleString("en")} ${noun}${count === 1 ? "" : "s"}`;

function seconds(value) {
  if (!Number.isFinite(value)) return "–";
  if (value < 0.0005) return "< 1 ms";
  if (value < 0.95) return `${(1000 * value).toFixed(0)} ms`;
  return value < 99.5 ? `${value.toFixed(1)} s` : `${(value / 60).toFixed(1)} min`;
}

const megabytes = (value) => (Number.isFinite(value) ? `${value < 10 ? value.toFixed(1) : value.toFixed(0)} MB` : "–");

function bytesOf(text) {
  const binary = atob(text),
    found = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) found[i] = binary.charCodeAt(i);
  return found;
}

const floatsOf = (text) => new Float32Array(bytesOf(text).buffer);
const shortsOf = (text) => new Uint16Array(bytesOf(text).buffer);

/** The upper three bytes of each float32: five digits, a quarter less to carry. */
function shortFloatsOf(text) {
  const packed = bytesOf(text),
    count = packed.length / 3,
    words = new Uint32Array(count);
  for (let i = 0; i < count; i++)
    words[i] = (packed[3 * i] << 8) | (packed[3 * i + 1] << 16) | (packed[3 * i + 2] << 24);
  return new Float32Array(words.buffer);
}
