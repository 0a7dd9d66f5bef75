/**
 * Before each file of tests. Files share modules (`isolate: false`), so what a test leaves behind is removed after it.
 *
 * What waits for a condition waits as long as a machine at its limit may take, not the second that is the default of `vi.waitFor` and
 * of `findBy…` and `waitFor` of the testing library.
 */
import { afterEach, vi } from "vitest";

const PATIENCE = { timeout: 20_000 };

const waitFor = Reflect.get(vi, "plainWaitFor") ?? vi.waitFor;
Reflect.set(vi, "plainWaitFor", waitFor);
vi.waitFor = (check, options = PATIENCE) => waitFor(check, options);

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

if (typeof document !== "undefined") {
  const { cleanup, configure } = await import("@testing-library/preact");
  configure({ asyncUtilTimeout: PATIENCE.timeout });
  afterEach(() => {
    cleanup();
    document.body.replaceChildren();
    localStorage.clear();
    sessionStorage.clear();
  });
}
