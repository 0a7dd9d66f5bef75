/** The plots on screen as evidence asks for them. */
import { byUnit, visible } from "../../plots/visible-plots";
import { type FigureSource, wantedOf } from "../../measure/figure-source";
import type { ViewState } from "../../data/view-state";
import { labelOf } from "../../signals/plot-selection";
import type { EvidencePlot, EvidenceSeries } from "../../wire/routes";

export interface EvidencePlots {
  readonly plots: EvidencePlot[];
  /** Labels of curves that the server cannot compute. */
  readonly without: readonly string[];
}

export function evidencePlots({ actions, hiddenSeries, yAxes }: ViewState, source: FigureSource): EvidencePlots {
  const without: string[] = [];
  const plots = visible(actions.plots(), hiddenSeries.peek())
    .flatMap(byUnit)
    .flatMap((plot): EvidencePlot[] => {
      const series = plot.series.flatMap((one): EvidenceSeries[] => {
        const wanted = wantedOf(one, source);
        if (wanted === undefined) {
          without.push(`${plot.title} ${labelOf(one)}`);
          return [];
        }
        const { word: signal, part, factor, offset, period } = wanted;
        const { colour, dash, decimals } = one;
        return [{ signal, part, factor, offset, period, label: labelOf(one), colour, dash: [...dash], decimals }];
      });
      if (series.length === 0) return [];
      const axis = yAxes.peek().get(plot.key);
      const [low, high] = axis?.range ?? [null, null];
      const title = plot.frame === "" ? plot.title : `${plot.title} · ${plot.frame}`;
      return [{ title, unit: plot.unit, series, low, high, log: axis?.isLog === true }];
    });
  return { plots, without };
}
