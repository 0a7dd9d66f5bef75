/**
 * One requestAnimationFrame loop for all painters. A browser tab in the background gets no frames, so nothing is drawn there,
 * while samples keep flowing into their rings.
 */

/** Called once per frame with the frame's time in ms, as performance.now(). */
export type Painter = (now: number) => void;

const painters = new Set<Painter>();
let isRunning = false;
let drawn = 0;

/** Frames drawn since the page was opened. */
export function framesDrawn(): number {
  return drawn;
}

function frame(now: number): void {
  isRunning = painters.size > 0;
  if (isRunning) requestAnimationFrame(frame);
  drawn += 1;
  for (const paint of painters) {
    try {
      paint(now);
    } catch (error) {
      // one broken panel must not stop the others, nor fill the console at 60 lines a second
      painters.delete(paint);
      reportError(error);
    }
  }
}

/** Call `paint` every frame until the returned function is called. */
export function onFrame(paint: Painter): () => void {
  painters.add(paint);
  if (!isRunning) requestAnimationFrame(frame);
  isRunning = true;
  return () => painters.delete(paint);
}
