// @vitest-environment happy-dom
/** Panels and plots put beside each other; with real gestures in tests/browser/test_tiles.py. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, it } from "vitest";
import { leaves } from "../data/tiles";
import { TEXT } from "../texts/workspace";
import { openPage } from "../testing/live-page";
import { press } from "../testing/queries";
import { recorded } from "../testing/recorded";
import { nearestEdge, panelBeside } from "./tile-grip";

const box = (left: number, top: number, width: number, height: number) =>
  ({ left, top, width, height, right: left + width, bottom: top + height }) as DOMRect;

it("a drop is at the edge that is nearest for the shape of the panel", () => {
  const wide = box(0, 0, 1000, 100);
  expect(nearestEdge(wide, 100, 40)).toBe("left");
  expect(nearestEdge(wide, 500, 70)).toBe("bottom");
  expect(nearestEdge(wide, 950, 50)).toBe("right");
});

it("the neighbour on a side is the nearest one that lies beside it", () => {
  const all = [
    { id: "a", box: box(0, 0, 100, 100) },
    { id: "b", box: box(101, 0, 100, 50) },
    { id: "c", box: box(101, 51, 100, 49) },
    { id: "d", box: box(202, 0, 100, 100) },
  ];
  expect(panelBeside(all, "a", "right")).toBe("b");
  expect(panelBeside(all, "d", "left")).toBe("b");
  expect(panelBeside(all, "b", "bottom")).toBe("c");
  expect(panelBeside(all, "a", "top")).toBeUndefined();
  expect(panelBeside(all, "gone", "top")).toBeUndefined();
});

async function opened() {
  const { app } = await openPage(recorded("xbus"));
  await waitFor(() => expect(document.querySelector("[data-panel=attitude]")).not.toBeNull());
  const { layout, plotOrder } = app.viewState;
  const grip = (id: string) => document.querySelector(`[data-grip=${id}]`) ?? document.body;
  const middle = () => leaves(layout.value.tiles ?? "");
  return { layout, plotOrder, middle, key: (id: string, key: string) => fireEvent.keyDown(grip(id), { key }) };
}

it("arrow keys move a panel beside the plots and around them, S into the side column and back, Delete hides it", async () => {
  const { layout, middle, key } = await opened();
  key("attitude", "ArrowRight");
  expect(layout.value.tiles).toEqual({ along: "row", parts: ["plots", "attitude"] });
  key("attitude", "ArrowDown");
  expect(layout.value.tiles).toEqual({ along: "column", parts: ["plots", "attitude"] });
  key("values", "s");
  await waitFor(() => expect(middle()).toEqual(["plots", "attitude", "values"]));
  key("values", "s");
  await waitFor(() => expect(middle()).toEqual(["plots", "attitude"]));
  key("values", "Delete");
  expect(layout.value.panels["values"]).toMatchObject({ shown: false });
  key("plots", "Delete");
  expect(layout.value.panels["plots"]).toBeUndefined();
  key("attitude", "Enter");
  expect(layout.value.maximised).toBe("attitude");
  for (let k = 0; k < 6; k += 1) press("z", { ctrlKey: true });
  expect(layout.value).toEqual({ panels: {}, order: {} });
});

it("a plot has a tile of its own, which goes with its last plot", async () => {
  const { middle, plotOrder } = await opened();
  const tiles = () => [...document.querySelectorAll<HTMLElement>(".tile")].map((one) => one.dataset["tile"]);
  press("w");
  await screen.findByRole("dialog", { name: TEXT.sheet });
  fireEvent.click(await screen.findByLabelText(TEXT.ownTile("Rate of turn")));
  expect(plotOrder.value).toEqual({ tiles: { RateOfTurn: "plots/2" } });
  expect(middle()).toEqual(["attitude", "plots", "plots/2"]);
  await waitFor(() => expect(tiles()).toEqual(["attitude", "plots", "plots/2"]));
  await waitFor(() => expect(document.querySelector("#plots-2 .plot")?.getAttribute("data-key")).toBe("RateOfTurn"));
  fireEvent.click(await screen.findByLabelText(TEXT.backToPlots("Rate of turn")));
  expect(plotOrder.value).toEqual({});
  await waitFor(() => expect(tiles()).toEqual(["attitude", "plots"]));
});
