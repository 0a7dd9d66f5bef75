/** Custom plots as plain data: what is drawn of them, how they change, and that a link brings them back. */
import { expect, test } from "vitest";
import type { Channel } from "../data/channels";
import type { CustomPlot, PlotSpec } from "../data/view";
import { legendRows } from "../plots/legend";
import { labelOf } from "./plot-selection";
import { placeQuery, readPlace } from "../page/permalink";
import { added, heldOf, misfit, removed, withCustomPlots } from "./custom-plots";

function channel(device: string, name: string, unit: string, axes: readonly ("x" | "y" | "z")[] = ["x", "y", "z"]) {
  const columns = axes.map((axis) => ({ name: axis, label: "", unit, axis, bits: [], dtype: "f4", decimals: -1 }));
  return {
    info: { device, name, title: name, unit, frame: "", kind: "vector", columns },
    ring: {},
  } as unknown as Channel;
}

const CHANNELS = [channel("1", "Acc", "m/s²"), channel("2", "Acc", "m/s²"), channel("1", "Free acc", "m/s²")];
const signal = (device: string, name: string, column: string) => ({ device, channel: name, column });
const own = (...signals: readonly ReturnType<typeof signal>[]): CustomPlot => ({ id: "p1", signals });
const only = (plots: readonly PlotSpec[]): PlotSpec => {
  expect(plots).toHaveLength(1);
  return plots[0]!;
};

test("signals of two devices share a plot, each with a colour of its own and the name of its device", () => {
  const plot = own(signal("1", "Acc", "x"), signal("2", "Acc", "x"), signal("2", "Acc", "y"));
  const { series, unit, title, custom } = only(withCustomPlots([], [plot], CHANNELS, "1"));
  expect([unit, title, custom]).toEqual(["m/s²", "Acc", "p1"]);
  expect(series.map(({ label }) => label)).toEqual(["#1 x", "#2 x", "#2 y"]);
  expect(series.map(({ heading }) => heading)).toEqual([undefined, undefined, undefined]); // the title tells it
  expect(new Set(series.map(({ colour, dash }) => `${colour} ${dash}`)).size).toBe(3);
  expect(series.map(({ colour }) => colour)).toEqual(["axis-x", "axis-x", "axis-y"]);
  expect(series[2]!.dash).toEqual(series[1]!.dash); // the device's own
});

test("twelve signals of one axis look different", () => {
  const many = Array.from({ length: 12 }, (_, k) => channel(String(k), "Acc", "m/s²"));
  const plot = own(...many.map(({ info }) => signal(info.device, "Acc", "x")));
  const { series } = only(withCustomPlots([], [plot], many, "1"));
  expect(new Set(series.map(({ colour, dash }) => `${colour} ${dash}`)).size).toBe(12);
});

test("a device that is away leaves its signals out, and the plot when nothing is left", () => {
  const plot = own(signal("1", "Acc", "x"), signal("9", "Acc", "x"));
  expect(only(withCustomPlots([], [plot], CHANNELS, "1")).series).toHaveLength(1);
  expect(withCustomPlots([], [own(signal("9", "Acc", "x"))], CHANNELS, "1")).toEqual([]);
});

test("what is added to a plot of a device is drawn on that device's plot only", () => {
  const base = only(withCustomPlots([], [own(signal("1", "Acc", "x"))], CHANNELS, "1"));
  const { custom: _, ...rest } = base;
  const plots = [{ ...rest, key: "Acc" }];
  const custom = added([], { kind: "device", device: "1", plot: "Acc" }, [signal("1", "Free acc", "z")]);
  const { series } = only(withCustomPlots(plots, custom, CHANNELS, "1"));
  expect(series.map(({ heading, label }) => [heading, label])).toEqual([
    [undefined, "x"],
    ["Free acc", "z"],
  ]);
  expect(only(withCustomPlots(plots, custom, CHANNELS, "2")).series).toHaveLength(1);
});

test("rows of two devices tell the device and the axis where names were cut to one beginning", () => {
  const base = only(withCustomPlots([], [own(signal("1", "Acc", "x"), signal("1", "Acc", "y"))], CHANNELS, "1"));
  const { custom: _, ...rest } = base;
  const warm = channel("2", "Temperature", "°C", ["x"]);
  const custom = added([], { kind: "device", device: "1", plot: "Acc" }, [
    signal("2", "Acc", "x"),
    signal("2", "Acc", "y"),
    signal("2", "Temperature", "x"),
  ]);
  const plot = only(withCustomPlots([{ ...rest, key: "Acc" }], custom, [...CHANNELS, warm], "1"));
  expect(plot.series.map((one) => [one.heading, one.label])).toEqual([
    [undefined, "x"],
    [undefined, "y"],
    [undefined, "#2 x"],
    [undefined, "#2 y"],
    ["Temperature", "#2"],
  ]);
  expect(labelOf(plot.series[4]!)).toBe("Temperature #2");
  expect(plot.series.map(({ dash }) => dash.length > 0)).toEqual([false, false, true, true, true]);
  expect(legendRows(plot)).toBe(6); // the plot grows with them
});

test("a signal is added once, and the last one removed takes the plot away", () => {
  const [x, y] = [signal("1", "Acc", "x"), signal("1", "Acc", "y")];
  const first = added([], { kind: "new" }, [x]);
  const target = { kind: "own", id: first[0]!.id } as const;
  const both = added(added(first, target, [x, y]), target, [y]);
  expect(both[0]!.signals).toEqual([x, y]);
  expect(heldOf(both, target, [x, signal("2", "Acc", "x")])).toEqual([x]);
  expect(added(both, { kind: "new" }, [x]).map(({ id }) => id)).toEqual(["p1", "p2"]);
  expect(removed(both, target, [x])[0]!.signals).toEqual([y]);
  expect(removed(both, target, [y, x])).toEqual([]);
});

test("a second unit has the right axis, a third one is refused with a sentence that names all", () => {
  const plot = { title: "Acc", unit: "m/s²" };
  expect(misfit(["m/s²"], plot)).toBeUndefined();
  expect(misfit(["°/s"], plot)).toBeUndefined();
  const right = { key: "", unit: "°/s", decimals: 2 };
  expect(misfit(["°/s", "m/s²"], { ...plot, right })).toBeUndefined();
  expect(misfit(["°C"], { ...plot, right })).toBe(
    "A plot has at most two units: Acc has m/s² and °/s, this signal is in °C. Put it on a new plot.",
  );
});

test("signals of two units: the first unit is on the left, and takes the left again when it is alone", () => {
  const gyro = channel("1", "Rate", "°/s");
  const channels = [...CHANNELS, gyro, channel("1", "Temp", "°C", ["x"])];
  const mixed = own(signal("1", "Acc", "x"), signal("1", "Rate", "x"), signal("1", "Temp", "x"));
  const plot = only(withCustomPlots([], [mixed], channels, "1"));
  expect([plot.unit, plot.right?.unit, plot.right?.key]).toEqual(["m/s²", "°/s", "custom:p1 right"]);
  expect(plot.series.map((one) => `${labelOf(one)} ${one.isRight === true}`)).toEqual(["Acc x false", "Rate x true"]);
  const rest = only(withCustomPlots([], [own(signal("1", "Rate", "x"))], channels, "1"));
  expect([rest.unit, rest.right]).toEqual(["°/s", undefined]);
});

test("a signal of another unit is added to the right axis of a device's plot", () => {
  const channels = [...CHANNELS, channel("1", "Temp", "°C", ["x"])];
  const { custom: _, ...base } = only(withCustomPlots([], [own(signal("1", "Acc", "x"))], channels, "1"));
  const plots = [{ ...base, key: "Acc" }];
  const custom = added([], { kind: "device", device: "1", plot: "Acc" }, [signal("1", "Temp", "x")]);
  const plot = only(withCustomPlots(plots, custom, channels, "1"));
  expect([plot.unit, plot.right]).toMatchObject(["m/s²", { key: "Acc right", unit: "°C" }]);
});

test("a link brings the plots back, whatever the names are", () => {
  const odd = signal("1.102", "Rate/turn, raw @ 1", "x?");
  const plots: readonly CustomPlot[] = [
    { id: "p1", signals: [odd, signal("1", "Acc", "x")] },
    { id: "p2", on: { device: "1", plot: "Acc/é" }, signals: [odd] },
  ];
  const query = placeQuery({ hide: [], show: [], panels: [], plots });
  expect(readPlace(query).plots).toEqual(plots);
  expect(readPlace("plot=%E0%A4%A&plot=@1&plot=1/Acc&plot=")).toEqual({ hide: [], show: [], panels: [] });
});
