/** Sharp canvases that follow the theme; shared by the instruments and sparklines. */

export interface Surface {
  readonly canvas: HTMLCanvasElement;
  readonly context: CanvasRenderingContext2D;
  /** Size in CSS pixels; 0 while hidden. */
  width(): number;
  height(): number;
  /** Clears to transparent, in CSS pixels from here on. False when there is nothing to draw on. */
  begin(): boolean;
  dispose(): void;
}

/**
 * Clears a canvas of this size, in the units of its context, visibly: with a graphics processor some browsers do not show a frame whose
 * only operation is `clearRect`, so the old picture stays on screen. An invisible dot is a second operation.
 */
export function clear(context: CanvasRenderingContext2D, width: number, height: number): void {
  context.globalAlpha = 1;
  context.clearRect(0, 0, width, height);
  context.fillStyle = "rgba(0, 0, 0, 0.004)";
  context.fillRect(0, 0, 1, 1);
}

/** Wraps `canvas`; `changed` is called when it must be drawn again because its size did. */
export function surface(canvas: HTMLCanvasElement, changed: () => void): Surface {
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser has no 2D canvas");
  let [width, height] = [0, 0];
  const observer = new ResizeObserver(() => {
    const box = canvas.getBoundingClientRect();
    [width, height] = [box.width, box.height];
    changed();
  });
  observer.observe(canvas);
  return {
    canvas,
    context,
    width: () => width,
    height: () => height,
    begin() {
      if (width < 2 || height < 2) return false;
      const ratio = globalThis.devicePixelRatio || 1;
      const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
      if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      clear(context, width, height);
      return true;
    },
    dispose: () => observer.disconnect(),
  };
}

let cache = new Map<string, string>();
let cachedTheme: string | undefined;

/** The value of a custom property, read once per theme. */
export function css(name: string): string {
  const theme = document.documentElement.dataset["theme"];
  if (theme !== cachedTheme) {
    cache = new Map();
    cachedTheme = theme;
  }
  let value = cache.get(name);
  if (value === undefined) {
    value = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    cache.set(name, value);
  }
  return value;
}

/** Sets the font of a canvas: pixels, weight, in the page's own face. */
export function font(context: CanvasRenderingContext2D, size: number, weight = 400): void {
  context.font = `${weight} ${size}px ${css("--font-ui")}`;
}
