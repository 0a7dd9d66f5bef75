/** The choices of the histogram: quantity, signals, range, scale, bins, and the values shown. */
import { Button } from "../../ui/controls/button";
import type { Channel } from "../../data/channels";
import type { ViewState } from "../../data/view-state";
import type { HistogramChoice } from "../../data/view";
import { plottable } from "../../signals/custom-plots";
import { ChartTools, Pair, RangeChoice, ChartSelect } from "../../charts/tools";
import { chosenSignals } from "./choice";
import { TEXT } from "./texts";

const BINS = [0, 10, 20, 50, 100, 200, 500, 1000];
const WITHIN = [0, 3, 4, 5, 6];

interface Props {
  readonly viewState: ViewState;
  readonly channels: readonly Channel[];
  readonly channel: Channel;
}

export function HistogramTools({ viewState, channels, channel }: Props) {
  const choice = viewState.histogram.value;
  const choose = (part: { readonly [name in keyof HistogramChoice]: HistogramChoice[name] | undefined }): void => {
    const next = { ...viewState.histogram.peek(), ...part };
    viewState.histogram.value = Object.fromEntries(Object.entries(next).filter(([, value]) => value !== undefined));
  };
  const shown = chosenSignals(channel, choice);
  const names = shown.map(({ column }) => channel.info.columns[column]?.name ?? "");
  const toggle = (name: string): void => {
    const next = names.includes(name) ? names.filter((one) => one !== name) : [...names, name];
    if (next.length > 0) choose({ channel: channel.info.name, columns: next });
  };
  return (
    <ChartTools>
      <ChartSelect
        label={TEXT.channel}
        value={channel.info.name}
        options={channels.map(({ info }) => [info.name, titleOf(info)])}
        onChange={(name) => choose({ channel: name, columns: undefined })}
      />
      {channel.info.columns.length > 1 && (
        <div class="segmented small" role="group" aria-label={TEXT.columns}>
          {plottable(channel).map((column) => {
            const info = channel.info.columns[column];
            if (!info) return null;
            return (
              <button
                type="button"
                key={info.name}
                aria-pressed={names.includes(info.name)}
                onClick={() => toggle(info.name)}
              >
                {info.label || info.name}
              </button>
            );
          })}
        </div>
      )}
      <RangeChoice viewState={viewState} range={choice.range} onChange={(range) => choose({ range })} />
      <Pair
        label={TEXT.scale}
        names={[TEXT.counts, TEXT.density]}
        second={choice.scale === "density"}
        onChange={(second) => choose({ scale: second ? "density" : undefined })}
      />
      <ChartSelect
        label={TEXT.bins}
        value={String(choice.bins ?? 0)}
        options={withOwn(BINS, choice.bins).map((n) => [String(n), n === 0 ? TEXT.automatic : String(n)])}
        onChange={(n) => choose({ bins: Number(n) || undefined })}
      />
      <ChartSelect
        label={TEXT.within}
        value={String(choice.within ?? 0)}
        options={withOwn(WITHIN, choice.within).map((n) => [String(n), n === 0 ? TEXT.all : TEXT.withinSigma(n)])}
        onChange={(n) => choose({ within: Number(n) || undefined })}
      />
      <Button
        look="toggle"
        words={TEXT.curve}
        aria-pressed={choice.noCurve !== true}
        title={TEXT.curveHint}
        onClick={() => choose({ noCurve: choice.noCurve ? undefined : true })}
      />
    </ChartTools>
  );
}

/** What a workspace may hold besides the offered ones. */
const withOwn = (offered: readonly number[], own: number | undefined): readonly number[] =>
  own === undefined || offered.includes(own) ? offered : [...offered, own];

function titleOf(info: Channel["info"]): string {
  const unit = info.unit || (info.columns.length === 1 ? (info.columns[0]?.unit ?? "") : "");
  return unit === "" ? info.title || info.name : `${info.title || info.name} (${unit})`;
}
