/** The plots in the list of the workspace: moved, made taller or lower, and given their height back, by keyboard or touch as well. */
import type { Deps } from "../page/context";
import { heightOf, movedTo, PLOT_HEIGHT, withHeight } from "../data/plot-order";
import type { PlotSpec } from "../data/view";
import { Button } from "../ui/controls/button";
import { IconButton } from "../ui/controls/icon-button";
import type { IconName } from "../ui/controls/icons";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/workspace";

/** A press changes the height by this, px. */
const STEP_PX = 24;

export function PlotList({ deps: { store, viewState } }: { readonly deps: Deps }) {
  const { plotOrder, actions, customPlots, extraPlots, device } = viewState;
  void [store.channels.value, customPlots.value, extraPlots.value, device.value];
  const of = plotOrder.value;
  const plots = actions.plots();
  const keys = plots.map(({ key }) => key);
  if (plots.length < 1) return null;
  const tool = (icon: IconName, label: string, isDisabled: boolean, act: () => void) => (
    <IconButton icon={icon} label={label} disabled={isDisabled} onClick={act} />
  );
  const size = ({ key }: PlotSpec, steps: number): void => {
    const now = heightOf(of, key) ?? document.querySelector(`.plot[data-key="${CSS.escape(key)}"]`)?.clientHeight;
    plotOrder.value = withHeight(of, key, (now ?? PLOT_HEIGHT[0]) + steps * STEP_PX);
  };
  return (
    <>
      <h3>{COMMON.plots}</h3>
      <ul class="plot-list">
        {plots.map((plot, k) => {
          const { key, title } = plot;
          const height = heightOf(of, key);
          const shown = height === undefined ? TEXT.automatic : TEXT.pixels(height);
          const move = (to: number) => () => (plotOrder.value = movedTo(of, keys, key, to));
          return (
            <li key={key} data-plot-row={key}>
              <b class="ellipsis">{title}</b>
              {tool("up", TEXT.moveUp(title), k === 0, move(k - 1))}
              {tool("down", TEXT.moveDown(title), k === plots.length - 1, move(k + 1))}
              {tool("minus", TEXT.lower(title), (height ?? Infinity) <= PLOT_HEIGHT[0], () => size(plot, -1))}
              {tool("plus", TEXT.taller(title), (height ?? 0) >= PLOT_HEIGHT[1], () => size(plot, 1))}
              <Button
                look="edge"
                words={shown}
                aria-label={TEXT.automaticHeightOf(shown, title)}
                disabled={height === undefined}
                onClick={() => (plotOrder.value = withHeight(of, key, undefined))}
              />
            </li>
          );
        })}
      </ul>
    </>
  );
}
