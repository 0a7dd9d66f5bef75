/**
 * The address follows the view, so that a reload restores it and a copied address shows it to others. It is written once the view
 * stands still, and at least each second while it moves: browsers limit how often a page may write it.
 */
import { showAddress } from "./test-hook";

/** Interval at which the view is looked at, ms. */
const LOOK_MS = 100;
/** Looks after which a view that keeps moving is written. */
const SETTLING_LOOKS = 10;

/**
 * Keep the address up to date.
 *
 * @param next the hash of what is shown; undefined while the address is not the view's to write
 * @param onWrite called with each hash, before it is written
 * @returns to stop
 */
export function keepAddress(next: () => string | undefined, onWrite: (hash: string) => void): () => void {
  let last: string | undefined;
  let moved = 0;
  let [written, became] = ["", ""]; // a browser may spell a hash in its own way
  let seen = location.hash;
  const isCurrent = (hash: string): boolean => hash === location.hash || (hash === written && location.hash === became);
  const look = (): void => {
    if (location.hash !== seen) {
      seen = location.hash; // a link or a page changed it, and its event may still wait: written over, the change would be lost
      return;
    }
    const now = next();
    const isMoving = now !== last;
    last = now;
    if (now !== undefined) showAddress(() => isCurrent(next() ?? ""));
    if (now === undefined || isCurrent(now)) {
      moved = 0;
      return;
    }
    moved += 1;
    if (isMoving && moved < SETTLING_LOOKS) return;
    moved = 0;
    onWrite(now);
    history.replaceState(null, "", now);
    [written, became] = [now, location.hash];
    seen = became;
  };
  const timer = setInterval(look, LOOK_MS);
  return () => clearInterval(timer);
}
