/** The plots as they are drawn: without hidden series, and by unit. Pure. */
import type { PlotSpec, Series } from "../data/view";

/** The plots with their series that are drawn. */
export function visible(plots: readonly PlotSpec[], hidden: ReadonlySet<string>): readonly PlotSpec[] {
  return plots
    .map((plot) => ({ ...plot, series: plot.series.filter(({ key }) => !hidden.has(key)) }))
    .filter(({ series }) => series.length > 0);
}

/** A plot with two units as two, each with the key of its axis. */
export function byUnit(plot: PlotSpec): readonly PlotSpec[] {
  const { right, series } = plot;
  const of = (isRight: boolean): readonly Series[] => series.filter((one) => (one.isRight === true) === isRight);
  if (right === undefined) return [plot];
  return [
    { ...plot, series: of(false) },
    { ...plot, key: right.key, unit: right.unit, series: of(true) },
  ].filter((one) => one.series.length > 0);
}
