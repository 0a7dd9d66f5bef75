// @vitest-environment happy-dom
/** Evidence of Live. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { openPage } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";

test("evidence of Live is made of what is in memory, without position where that is left out", async () => {
  const saved = { id: "part", devices: ["1"], t0: 0, t1: 1, bytes: 1 };
  const job = { id: 1, recording: "part", title: "Evidence", file: "evidence-part.html", state: "done", progress: 1 };
  const { app, asked } = await openPage(recorded("xbus"), {
    answers: {
      "POST /api/recordings/save-memory": saved,
      "POST /api/recordings/part/evidence": { ...job, size: 1000, message: "", hint: "" },
    },
  });
  await waitFor(() => expect(app.viewState.actions.plots().length).toBeGreaterThan(0));
  fireEvent.keyDown(document.body, { key: "e" });
  const form = await screen.findByRole("dialog", { name: /^Evidence of Live/ });
  fireEvent.click(within(form).getByLabelText(/^Leave out position/));
  const clicked = vi.spyOn(HTMLAnchorElement.prototype, "click").mockImplementation(() => {});
  fireEvent.click(within(form).getByRole("button", { name: "Make the file" }));
  const link = await within(form).findByRole("link", { name: "Download" });
  expect(link.getAttribute("download")).toBe(job.file);
  expect(clicked.mock.instances, "without a second press").toMatchObject([{ download: job.file }]);
  interface Body {
    readonly t0: number;
    readonly t1: number;
    readonly plots: readonly { readonly title: string }[];
  }
  const [memory, evidence] = asked.filter(({ method }) => method === "POST").map(({ body }) => body as Body);
  const { t0 = 0, t1 = 0, plots = [] } = evidence ?? {};
  expect(t1 - t0).toBeCloseTo(app.viewState.view.value.span, 3);
  expect(memory).toMatchObject({ devices: null, t0: t0 - 1, t1: t1 + 1 });
  expect(evidence).toMatchObject({ with_position: false, cursor_a: null, cursor_b: null });
  const titles = plots.map(({ title }) => title);
  expect(titles).toEqual(expect.arrayContaining(["Acceleration", "Rate of turn"]));
  expect(titles.some((title) => title.startsWith("Roll, pitch"))).toBe(true);
});
