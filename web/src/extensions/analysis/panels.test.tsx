// @vitest-environment happy-dom
/** Panels of analyses in a workspace. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { signal } from "@preact/signals";
import { expect, it } from "vitest";
import { createViewState } from "../../data/view-state";
import { recorded } from "../../testing/recorded";
import { openPage } from "../../testing/live-page";
import { TEXT } from "../../texts/workspace";
import { applyWorkspace, withoutMoment, workspaceOf } from "../../workspace/parts";
import { press } from "../../testing/queries";

const panels = () => [...document.querySelectorAll("[data-panel]")].map((one) => one.getAttribute("data-panel"));
const DEFAULT = ["attitude", "plots", "values", "health", "alarms", "events"];

async function arranging() {
  const page = await openPage(recorded("xbus"));
  await waitFor(() => expect(panels()).toEqual(DEFAULT));
  press("w");
  await screen.findByRole("dialog", { name: TEXT.sheet });
  return page;
}

const ANALYSES = [
  {
    allan: { motion: "include", signals: "RateOfTurn", temperature: "include" },
    psd: { frequencyAxis: "log", length: 1024, scale: "power" },
  },
  { spectrogram: { range: "everything", signals: "norm(Acceleration), RateOfTurn.x", window: "flattop" } },
];

it("what the panels show is restored from a workspace, on a fresh view and on one with others", () => {
  const used = createViewState();
  for (const analyses of [...ANALYSES, ...ANALYSES]) {
    for (const viewState of [createViewState(), used]) {
      const view = { viewState, folded: signal(false) };
      expect(
        applyWorkspace(view, { format: "imuscope-workspace", version: 1, parts: { analyses } }, withoutMoment),
      ).toEqual([]);
      expect(workspaceOf(view, withoutMoment).parts).toEqual({ analyses });
    }
  }
});

it("a panel that is shown on request only is in the list, and is stored once it is shown", async () => {
  const { app } = await arranging();
  expect(panels()).toEqual(DEFAULT);
  fireEvent.click(screen.getByLabelText(TEXT.showPanel("Spectrum")));
  await waitFor(() => expect(panels()).toEqual(["attitude", "plots", "spectrum", ...DEFAULT.slice(2)]));
  expect(app.viewState.layout.value.panels["spectrum"]).toEqual({ shown: true });
  const scale = await screen.findByLabelText("Frequency axis", {}, { timeout: 20_000 }); // its code is fetched now
  expect(screen.queryByRole("button", { name: "Allan deviation" })).toBeNull(); // a panel of its own
  fireEvent.change(scale, { target: { value: "log" } });
  expect(app.viewState.analyses.value).toEqual({ psd: { frequencyAxis: "log" } });
  for (let k = 0; k < 2; k += 1) press("z", { ctrlKey: true });
  await waitFor(() => expect(panels()).toEqual(DEFAULT));
  expect(app.viewState.analyses.value).toEqual({});
});

it("an earlier workspace, with spectrum and Allan deviation in one panel, opens as it was", async () => {
  const { app } = await arranging();
  const layout = {
    panels: { analysis: { shown: true, height: 500 }, xy: { shown: true } },
    order: { main: ["plots", "analysis", "xy"] },
  };
  const parts = { layout, xy: { x: ["Acceleration", "x"], y: ["Acceleration", "y"] } };
  const problems = applyWorkspace(
    { viewState: app.viewState, folded: app.folded },
    { format: "imuscope-workspace", version: 1, parts },
    withoutMoment,
  );
  expect(problems).toEqual([]);
  await waitFor(() => expect(panels().slice(0, 3)).toEqual(["plots", "analysis", "xy"]));
  expect(document.querySelector<HTMLElement>('[data-tile="analysis"]')?.style.height).toBe("500px");
  fireEvent.click(await screen.findByRole("button", { name: "Allan deviation" }, { timeout: 20_000 }));
  expect(await screen.findByLabelText("Motion")).toBeTruthy();
});
