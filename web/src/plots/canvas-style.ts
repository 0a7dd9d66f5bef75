/**
 * Drawing style: the theme's colours and sizes, read from the custom properties once per theme and layout instead of once per
 * stroke, canvases as sharp as the screen, and the hatch.
 */

import { clear } from "../ui/dom/canvas";

const COLOURS = [
  "bg",
  "bg-rail",
  "bg-hover",
  "bg-active",
  "line",
  "line-strong",
  "edge",
  "grid",
  "grid-zero",
  "ink",
  "ink-2",
  "ink-3",
  "invert-bg",
  "invert-ink",
  "axis-x",
  "axis-y",
  "axis-z",
  "axis-n",
  "status-warn",
  "status-warn-ink",
  "status-bad",
  "status-bad-ink",
  "loss",
  "yours",
  "yours-ink",
] as const;
export type Colour = (typeof COLOURS)[number];

export interface Palette {
  readonly colour: Readonly<Record<Colour, string>>;
  readonly font: string;
  /** Size of tick labels, px. */
  readonly small: number;
  /** Left edge of the plots and room at their right end, px. */
  readonly gutter: number;
  readonly tail: number;
  /** The gutter is too narrow for a legend, which is then above the plot. */
  readonly narrow: boolean;
}

/** A gutter below this holds no legend, px. */
const LEGEND_FITS = 130;

/** Read the theme at `element`. */
export function palette(element: Element): Palette {
  const style = getComputedStyle(element);
  const get = (name: string): string => style.getPropertyValue(`--${name}`).trim();
  const colour = Object.fromEntries(COLOURS.map((name) => [name, get(name)])) as Record<Colour, string>;
  const gutter = parseFloat(get("gutter-w")) || 164;
  return {
    colour,
    font: get("font-ui") || "sans-serif",
    small: parseFloat(get("text-2xs")) || 10.5,
    gutter,
    tail: parseFloat(get("tail-w")) || 40,
    narrow: gutter < LEGEND_FITS,
  };
}

/** Calls `changed` whenever the size of an element or the theme has changed, until the returned function is called. */
export function onLook(element: Element, changed: () => void): () => void {
  const resized = new ResizeObserver(changed);
  resized.observe(element);
  const themed = new MutationObserver(changed);
  themed.observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
  return () => {
    resized.disconnect();
    themed.disconnect();
  };
}

export function setFont(x: CanvasRenderingContext2D, look: Palette, size: number, weight = 400): void {
  x.font = `${weight} ${size}px ${look.font}`;
}

/** A canvas with its size, in CSS px; its pixels follow the screen's. */
export class CanvasLayer {
  readonly x: CanvasRenderingContext2D;
  width = 0;
  height = 0;
  /** Device pixels per CSS pixel. */
  ratio = 1;

  constructor(readonly canvas: HTMLCanvasElement) {
    const context = canvas.getContext("2d");
    if (context === null) throw new Error("this browser has no 2D canvas");
    this.x = context;
  }

  /** Set the size; true if it changed, and the canvas is blank. */
  resize(width: number, height: number): boolean {
    const ratio = globalThis.devicePixelRatio || 1;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    this.width = width;
    this.height = height;
    this.ratio = ratio;
    if (this.canvas.width === w && this.canvas.height === h) return false;
    this.canvas.width = w;
    this.canvas.height = h;
    return true;
  }

  /** Clear; the unit is CSS pixels. */
  begin(): CanvasRenderingContext2D {
    const { x, ratio } = this;
    x.setTransform(ratio, 0, 0, ratio, 0, 0);
    clear(x, this.width, this.height);
    return x;
  }

  /** A CSS coordinate rounded to the nearest device pixel, so that hairlines are sharp. */
  snap(v: number): number {
    return Math.round(v * this.ratio) / this.ratio;
  }
}

const hatches = new Map<string, CanvasPattern | null>();

/** Diagonal lines `gap` px apart, for missing, floating or unknown data. */
export function hatch(x: CanvasRenderingContext2D, colour: string, gap: number): CanvasPattern | string {
  const key = `${colour} ${gap}`;
  let pattern = hatches.get(key);
  if (pattern === undefined) {
    const size = gap * 2;
    const tile = document.createElement("canvas");
    tile.width = tile.height = size;
    const h = tile.getContext("2d");
    if (h !== null) {
      h.strokeStyle = colour;
      h.lineWidth = 1.4;
      h.beginPath();
      for (let o = -size; o < 2 * size; o += gap) {
        h.moveTo(o, size);
        h.lineTo(o + size, 0);
      }
      h.stroke();
    }
    hatches.set(key, (pattern = x.createPattern(tile, "repeat")));
  }
  return pattern ?? colour;
}

/** As much of a text as fits. */
export function fitting(x: CanvasRenderingContext2D, text: string, room: number): string {
  let cut = text;
  while (cut.length > 1 && x.measureText(cut).width > room) cut = `${cut.slice(0, -2)}…`;
  return cut;
}
