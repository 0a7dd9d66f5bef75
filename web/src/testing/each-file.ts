/**
 * Before each file of tests. Files share modules (`isolate: false`), so what a test leaves behind is removed after it.
 *
 * What waits for a condition waits as long as a machine at its limit may take, not the second that is the default of `vi.waitFor` and
 * of `findBy…` and `waitFor` of the testing library.
 */
import { afterAll, afterEach, vi } from "vitest";
import { isViewOnly } from "../wire/capabilities";
import { endTimers, watchTimers } from "./timers";

const PATIENCE = { timeout: 20_000 };
const FRAME_MS = 4;

const waitFor = Reflect.get(vi, "plainWaitFor") ?? vi.waitFor;
Reflect.set(vi, "plainWaitFor", waitFor);
vi.waitFor = (check, options = PATIENCE) => waitFor(check, options);

watchTimers();
afterAll(endTimers);

afterEach(() => {
  isViewOnly.value = false; // files share modules: a refused request in one disabled buttons in the next
  vi.useRealTimers();
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
  if (typeof sessionStorage !== "undefined") sessionStorage.clear();
});

if (typeof document !== "undefined") {
  const { buildDetachedTreesOnce } = await import("./detached-trees"); // which loads happy-dom
  buildDetachedTreesOnce();
  const { cleanup, configure, prettyDOM } = await import("@testing-library/preact");
  configure({ asyncUtilTimeout: PATIENCE.timeout, getElementError: lazyError });

  /** Printing the document for each element that is still missing took a fifteenth of the time: it is printed when it is read. */
  function lazyError(words: string | null, container: Element): Error {
    let text: string | undefined;
    const error = new Error();
    const get = (): string => {
      text ??= [words, prettyDOM(container)].filter(Boolean).join("\n\n");
      return text;
    };
    return Object.defineProperty(error, "message", { get, set: (value) => (text = value), configurable: true });
  }

  // happy-dom has the next frame at once, so that a page which a test waits for would draw all the time.
  const { setTimeout, clearTimeout } = globalThis; // not those of a test that turns the clock
  // The loop of painters is one for all files: a frame that it waited for when the timers of a file were ended comes in the next one.
  const frames: Map<number, FrameRequestCallback> = Reflect.get(vi, "frames") ?? new Map();
  Reflect.set(vi, "frames", frames);
  const begun = [...frames.values()];
  frames.clear();
  window.requestAnimationFrame = (paint) => {
    const frame = Number(setTimeout(() => frames.delete(frame) && paint(performance.now()), FRAME_MS));
    frames.set(frame, paint);
    return frame;
  };
  window.cancelAnimationFrame = (frame) => frames.delete(frame) && clearTimeout(frame);
  begun.forEach(window.requestAnimationFrame);

  // No style sheet is loaded, so a style is what its element says. Roles and names ask for the style of each element and of all that it
  // is in, for which happy-dom takes a tenth of the time.
  window.getComputedStyle = (element) => (element as HTMLElement).style;

  afterEach(() => {
    cleanup();
    document.body.replaceChildren();
    localStorage.clear();
    sessionStorage.clear();
  });
}
