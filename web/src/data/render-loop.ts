/**
 * Who draws when? One requestAnimationFrame loop asks everybody who has something on screen. A browser tab in the background
 * gets no frames, so nothing is drawn there, while samples keep flowing into their rings.
 */

/** Called once a frame with the time of the frame in ms, as performance.now() counts. */
export type Painter = (now: number) => void;

const painters = new Set<Painter>();
let handle: number | undefined;
let drawn = 0;

/** Frames drawn since the page was opened. */
export function framesDrawn(): number {
  return drawn;
}

function frame(now: number): void {
  handle = painters.size > 0 ? requestAnimationFrame(frame) : undefined;
  drawn += 1;
  for (const paint of painters) {
    try {
      paint(now);
    } catch (error) {
      // One broken panel must not stop the others, nor fill the console at 60 lines a second.
      painters.delete(paint);
      reportError(error);
    }
  }
}

/** Have `paint` called every frame until the returned function is called. */
export function onFrame(paint: Painter): () => void {
  painters.add(paint);
  handle ??= requestAnimationFrame(frame);
  return () => painters.delete(paint);
}
