// Numbers to colours. Maps are tables of 256 sRGB colours, interpolated in OKLab so that equal steps look equal.

import type { Attribute } from './protocol.ts';

export type Rgb = [number, number, number];
export type Table = Uint8Array<ArrayBuffer>;

const linear = (c: number) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
const gamma = (c: number) => (c <= 0.0031308 ? c * 12.92 : 1.055 * c ** (1 / 2.4) - 0.055);

function labOf(hex: string): Rgb {
  const n = parseInt(hex, 16);
  const [r, g, b] = [n >> 16, (n >> 8) & 255, n & 255].map((c) => linear(c / 255));
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return [
    0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s,
    1.9779984951 * l - 2.428592205 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.808675766 * s,
  ];
}

function rgbOf([L, a, b]: Rgb): Rgb {
  const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (L - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const rgb = [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ];
  return rgb.map((c) => Math.round(255 * Math.min(1, Math.max(0, gamma(Math.max(0, c)))))) as Rgb;
}

function table(colour: (at: number) => Rgb): Table {
  const out = new Uint8Array(256 * 4);
  for (let i = 0; i < 256; i++) out.set([...colour(i / 255), 255], i * 4);
  return out;
}

function between(hexes: string): Table {
  const stops = hexes.split(' ').map(labOf);
  return table((at) => {
    const place = at * (stops.length - 1);
    const i = Math.min(stops.length - 2, Math.floor(place));
    const f = place - i;
    return rgbOf(stops[i].map((c, k) => c + (stops[i + 1][k] - c) * f) as Rgb);
  });
}

export const MAPS = {
  viridis: between('440154 482878 3e4a89 31688e 26828e 1f9e89 35b779 6dcd59 b4de2c fde725'),
  /** Without its black end, which would vanish on a dark page. */
  inferno: between('420a68 6a176e 932667 bc3754 dd513a f37819 fca50a f6d746 fcffa4'),
  balance: between('2166ac 4393c3 92c5de d9dde0 f4a582 d6604d b2182b'),
  /** Equal lightness and chroma all round. */
  hues: table((at) => rgbOf([0.74, 0.13 * Math.cos(at * 2 * Math.PI), 0.13 * Math.sin(at * 2 * Math.PI)])),
};

/** Okabe and Ito's colours, told apart with any colour vision. */
const KNOWN: Record<string, string> = {
  missing: '8a8a8a',
  kept: '009e73',
  observed: '009e73',
  diffused: '56b4e9',
  simulated: 'e69f00',
  completed: 'cc79a7',
};
const MORE = ['0072b2', 'd55e00', 'e69f00', 'cc79a7', '56b4e9', 'f0e442'];

export function categoryColour(name: string, index: number): Rgb {
  const n = parseInt(KNOWN[name] ?? MORE[index % MORE.length], 16);
  return [n >> 16, (n >> 8) & 255, n & 255];
}

/** How numbers become colours: a table over a range; `steps` where the numbers are categories. */
export interface Scale {
  title: string;
  /** The title in more words. */
  about: string;
  unit: string;
  range: [number, number];
  table: Table;
  categories?: string[];
}

function mapOf(attribute: Attribute): Table {
  const [lo, hi] = attribute.range;
  if (lo < 0 && hi > 0) return MAPS.balance;
  return /error|residual/.test(attribute.name) ? MAPS.inferno : MAPS.viridis;
}

export function scaleOf(attribute: Attribute, range: [number, number] | null): Scale {
  const title = words(attribute.name);
  const about = attribute.title ?? '';
  if (attribute.categories) {
    const names = attribute.categories;
    const colours = table((at) => {
      const i = Math.min(names.length - 1, Math.floor(at * names.length));
      return categoryColour(names[i], i);
    });
    return { title, about, unit: '', range: [-0.5, names.length - 0.5], table: colours, categories: names };
  }
  let [lo, hi] = range ?? attribute.range;
  // A map with a middle is honest only with zero in its middle.
  if (!range && lo < 0 && hi > 0) [lo, hi] = [-Math.max(-lo, hi), Math.max(-lo, hi)];
  if (!(hi > lo)) hi = lo + 1;
  return { title, about, unit: attribute.unit, range: [lo, hi], table: mapOf(attribute) };
}

export const STRAND_SCALE: Scale = { title: 'Strand number', about: 'neighbours by number differ most', unit: '', range: [0, 1], table: MAPS.hues };
export const ROOT_SCALE: Scale = { title: 'Root direction', about: 'about the head’s upright axis', unit: '', range: [0, 1], table: MAPS.hues };

/** A hue for every strand; neighbours by number differ most (golden section). */
export function strandHues(first: number, stride: number, strands: number): Float32Array {
  return Float32Array.from({ length: strands }, (_, i) => ((first + i * stride) * 0.618033988749895) % 1);
}

/** The colour of a value as an index of the scale's table; -1 for none. */
export function bucket(scale: Scale, value: number): number {
  if (!Number.isFinite(value)) return -1;
  const [lo, hi] = scale.range;
  return Math.min(255, Math.max(0, Math.round((255 * (value - lo)) / (hi - lo))));
}

export const css = ([r, g, b]: Rgb) => `rgb(${r} ${g} ${b})`;
export const tableColour = (t: Table, i: number): Rgb => [t[i * 4], t[i * 4 + 1], t[i * 4 + 2]];

/** `length_change` as a person writes it. */
export function words(name: string): string {
  const text = name.replaceAll('_', ' ');
  return text.charAt(0).toUpperCase() + text.slice(1);
}

export function number(value: number | null | undefined, digits = 3): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  if (value === 0) return '0';
  const size = Math.abs(value);
  const text = size >= 1e6 || size < 1e-3 ? value.toExponential(digits - 1) : value.toPrecision(digits);
  const plain = /e/.test(text) && size < 1e6 && size >= 1e-3 ? Math.round(value).toString() : text;
  return plain.replace(/(\.\d*?)0+($|e)/, '$1$2').replace(/\.($|e)/, '$1').replace('-', '−');
}
