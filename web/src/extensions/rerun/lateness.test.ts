/** How late the page of Rerun's viewer says its picture is (server/extensions/rerun/page/start.js). */
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { expect, it } from "vitest";

const PAGE = join(import.meta.dirname, "../../../../server/extensions/rerun/page/start.js");

/** Regression: "1700 ms behind" stood under a viewer that was 17.3 s behind: what a sample waits for in the browser counts. */
it("of two ages the larger one counts", () => {
  const source = /let shortest.*?\n}\n/s.exec(readFileSync(PAGE, "utf8"))?.[0] ?? "";
  const lateness = new Function(`${source} return lateness;`)() as (
    report: { readonly lag_ms: number; readonly sent_ms: number },
    now: number,
  ) => number;
  expect(lateness({ lag_ms: 40, sent_ms: 1000 }, 5010)).toBe(40); // another clock
  expect(lateness({ lag_ms: 1700, sent_ms: 2000 }, 21_610)).toBe(17_300);
});
