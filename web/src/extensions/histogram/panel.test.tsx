// @vitest-environment happy-dom
/** The histogram on the page: which signals are counted, what the server is asked for, and the scale. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import { openPage } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";
import type { AnalysisRequest } from "../../wire/routes";
import { DEFAULT_LAYOUT, show } from "../../data/layout";

const FIGURES = {
  ...{ edges: [9, 9.5, 10], counts: [10, 30], density: [0.5, 1.5], n: 43, below: 1, above: 2 },
  ...{ mean: 9.8, sigma: 0.4, min: 9, max: 10, at_min: 1, at_max: 2, width: 0.5, notes: ["A note of the server."] },
};
const SIGNAL = { signal: "Acceleration", device: "1", units: {}, figures: FIGURES };

test("a quantity, its columns, the bins and the scale are chosen, and the server's figures are shown", async () => {
  const answers = { "POST /api/analysis/histogram": [SIGNAL, SIGNAL, SIGNAL] };
  const { app, asked } = await openPage(recorded("xbus"), { answers });
  app.viewState.layout.value = show(DEFAULT_LAYOUT, { id: "histogram", where: "main", optional: true }, true);
  const panel = await screen.findByRole("region", { name: "Histogram" });
  const outlines = (): number => panel.querySelectorAll("path.bins").length;
  await waitFor(() => expect(outlines()).toBe(3));
  const quantity = within(panel).getByLabelText<HTMLSelectElement>("Quantity");
  const acceleration = [...quantity.options].find(({ text }) => text === "Acceleration (m/s²)");
  fireEvent.change(quantity, { target: { value: acceleration?.value } });
  for (const name of ["x", "y"]) fireEvent.click(await within(panel).findByRole("button", { name }));
  await waitFor(() => expect(outlines()).toBe(1));
  expect(panel.querySelector("tbody")?.textContent).toMatch(/9\.80* ± /);
  expect(panel.textContent).toContain("A note of the server.");
  fireEvent.change(within(panel).getByLabelText("Bins"), { target: { value: "50" } });
  fireEvent.change(within(panel).getByLabelText("Values"), { target: { value: "3" } });
  await waitFor(() =>
    expect((asked.at(-1)?.body as AnalysisRequest | undefined)?.options).toEqual({ bins: 50, within: 3 }),
  );
  fireEvent.click(within(panel).getByRole("button", { name: "Density" }));
  await waitFor(() => expect(panel.textContent).toContain("Density, 1/(m/s²)"));
});
