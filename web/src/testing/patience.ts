/**
 * Before each file of tests: what waits for a condition waits as long as a machine at its limit may take, not the second that is the
 * default of `vi.waitFor` and of `findBy…` and `waitFor` of the testing library.
 */
import { vi } from "vitest";

const PATIENCE = { timeout: 20_000 };

const { waitFor } = vi;
vi.waitFor = (check, options = PATIENCE) => waitFor(check, options);

if (typeof document !== "undefined") {
  const { configure } = await import("@testing-library/preact");
  configure({ asyncUtilTimeout: PATIENCE.timeout });
}
