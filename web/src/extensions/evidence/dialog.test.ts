import { describe, expect, it } from "vitest";
import type { ViewState } from "../../data/view-state";
import type { FigureSource } from "../../measure/figure-source";
import type { PlotSpec } from "../../data/view";
import { evidencePlots } from "./dialog";

const column = (name: string) => ({ name, period: 0, unit: "", label: "", bits: [], choices: {} });
const info = (id: number, name: string, columns: readonly string[]) =>
  ({ id, device: "1", name, kind: "vector", frame: "", unit: "", columns: columns.map(column) }) as never;
const ACCELERATION = info(1, "Acceleration", ["x", "y", "norm"]);
const TURN = info(2, "RateOfTurn", ["x"]);

function series(channel: unknown, at: number, key: string, more: object = {}): PlotSpec["series"][number] {
  const look = { label: key, colour: "axis-x", dash: [], norm: false, decimals: 3 };
  return { channel: { info: channel }, column: at, key, ...look, ...more } as never;
}

const plot = (own: Partial<PlotSpec>): PlotSpec =>
  ({ key: "a", title: "Acceleration", unit: "m/s²", frame: "", decimals: 3, series: [], ...own }) as never;

function viewOf(plots: readonly PlotSpec[], hidden: readonly string[] = []): ViewState {
  const yAxes = new Map([["a/right", { range: [-5, 5] as const, isLog: true }]]);
  return {
    actions: { plots: () => plots },
    hiddenSeries: { peek: () => new Set(hidden) },
    yAxes: { peek: () => yAxes },
  } as never;
}

const SOURCE: FigureSource = {
  id: "",
  prefix: ({ device }) => `${device}/`,
  sent: (id) => [info(1, "Acceleration", ["x", "y"]), TURN].find((one: { id: number }) => one.id === id) as never,
  changeOf: () => undefined,
};

describe("plots for evidence", () => {
  it("are those on screen: signals as the server names them, without hidden curves", () => {
    const shown = plot({
      frame: "ENU",
      series: [series(ACCELERATION, 0, "x"), series(ACCELERATION, 1, "y"), series(ACCELERATION, 2, "n")],
    });
    const { plots, without } = evidencePlots(viewOf([shown], ["y"]), SOURCE);
    expect(without).toEqual([]);
    expect(plots).toHaveLength(1);
    expect(plots[0]).toMatchObject({ title: "Acceleration · ENU", unit: "m/s²", low: null, high: null });
    expect(plots[0]?.series.map(({ signal }) => signal)).toEqual(["1/Acceleration.x", 'norm("1/Acceleration")']);
  });

  it("are two where a plot has two units, each with its own range", () => {
    const both = plot({
      series: [series(ACCELERATION, 0, "x"), series(TURN, 0, "w", { isRight: true })],
      right: { key: "a/right", unit: "°/s", decimals: 2 },
    });
    const { plots } = evidencePlots(viewOf([both]), SOURCE);
    expect(plots.map(({ unit, low, high, log }) => [unit, low, high, log])).toEqual([
      ["m/s²", null, null, false],
      ["°/s", -5, 5, true],
    ]);
  });

  it("name the curves that the server cannot compute", () => {
    const foreign = plot({ series: [series(info(9, "Elsewhere", ["x"]), 0, "away")] });
    expect(evidencePlots(viewOf([foreign]), SOURCE)).toEqual({ plots: [], without: ["Acceleration away"] });
  });
});
