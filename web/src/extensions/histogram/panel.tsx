/**
 * The histogram: of the signals of one quantity, in the range of the plots or between both cursors. The server counts every sample,
 * live and recorded alike.
 */
import { signal, type Signal } from "@preact/signals";
import { render } from "preact";
import { figure } from "../../charts/axes";
import { colourOf } from "../../charts/curve-colours";
import type { HistogramChoice } from "../../data/view";
import { LatestAnswer } from "../../requests/latest-answer";
import { liveSource } from "../../measure/sample-access";
import { wantedOf, type FigureSource, type Wanted } from "../../measure/figure-source";
import { channelsOf } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { unitOf, plottable, type Found } from "../../signals/custom-plots";
import { throttle, type Panel } from "../../ui/dom/dom";
import { number } from "../../ui/format/format";
import { request } from "../../requests/http";
import { Answered } from "../../requests/use-answer";
import { TableHead } from "../../ui/controls/table-head";
import type { AnalysisRequest, SignalFigures } from "../../wire/routes";
import { rangeOf } from "../../charts/range";
import { HistogramChart, type HistogramContent } from "./chart";
import { chosenChannel, chosenSignals, countable } from "./choice";
import { binsOf, clippedIn } from "./figures";
import { TEXT } from "./texts";
import { Button } from "../../ui/controls/button";
import type { Channel } from "../../data/channels";
import type { ViewState } from "../../data/view-state";
import { ChartTools, Pair, RangeChoice, ChartSelect } from "../../charts/tools";
import "./histogram.css";

/** Live figures are asked for this often, ms, as far as the server keeps up. */
const LIVE_MS = 500;
/** What is to be asked is looked at this often a second: lists of channels are not made once a frame. */
const PER_SECOND = 10;

interface Content {
  readonly shown: readonly HistogramContent[];
  readonly unit: string;
}

class Histogram implements Panel {
  readonly #host: HTMLElement;
  readonly #deps: Deps;
  readonly #due = throttle(PER_SECOND);
  readonly #latest = new LatestAnswer<Content>();
  readonly #question = signal("");
  /** Why nothing can be asked. */
  readonly #lost = signal("");

  constructor(host: HTMLElement, deps: Deps) {
    this.#host = host;
    this.#deps = deps;
    render(<View deps={deps} latest={this.#latest} question={this.#question} lost={this.#lost} />, host);
  }

  update(now: number): void {
    if (!this.#due(now)) return;
    const { viewState, store, samples, recording } = this.#deps;
    const view = viewState.view.peek();
    const choice = viewState.histogram.peek();
    const channel = chosenChannel(countable(channelsOf(this.#deps)), choice);
    if (channel === undefined || view.device === undefined) return;
    const source = samples?.source ?? liveSource(store, view.device);
    const wanted = chosenSignals(channel, choice).map((found) => ({ found, how: wantedOf(found, source) }));
    const lost = wanted.find(({ how }) => how === undefined)?.found;
    const { actions, measure } = viewState;
    const isCursors = choice.range === "cursors" && actions.cursorTime() !== undefined && measure.peek() !== undefined;
    const [t0, t1] = rangeOf(choice, actions.cursorTime(), measure.peek(), actions.rightEdge(), view.span);
    const of = `${JSON.stringify(choice)} ${wanted.map(({ how }) => `${how?.word} ${how?.part} ${how?.factor}`).join()}`;
    const isMoving = !isCursors && (view.live || (recording?.rate() ?? 0) > 0);
    const question = `${source.id} ${of} ${view.timeBase} ${isMoving ? view.span : `${t0} ${t1}`}`;
    this.#question.value = question;
    this.#lost.value = lost ? TEXT.frameUnknown(lost.channel.info.title || lost.channel.info.name) : "";
    if (lost !== undefined) return;
    const range = { t0, t1, base: view.timeBase };
    const turn = isMoving ? String(Math.floor(now / LIVE_MS)) : "";
    this.#latest.want(question, now, (stop) => ask(source, range, wanted as readonly Asked[], choice, stop), turn);
  }

  dispose(): void {
    this.#latest.dispose();
    render(null, this.#host);
  }
}

interface Asked {
  readonly found: Found;
  readonly how: Wanted;
}

async function ask(
  source: FigureSource,
  range: Pick<AnalysisRequest, "t0" | "t1" | "base">,
  wanted: readonly Asked[],
  { bins, within }: HistogramChoice,
  stop: AbortSignal,
) {
  const words = [...new Map(wanted.map(({ how }) => [how.word, how])).values()];
  const options = { bins: bins ?? 0, within: within ?? 0 };
  const body = { source: source.id, signals: words.map(({ word }) => word), ...range, options };
  const outcome = await request("POST /api/analysis/{name}", { path: { name: "histogram" }, body, signal: stop });
  if (!outcome.ok) return outcome;
  const list = outcome.value as readonly SignalFigures[];
  const firstOf = (word: string): number =>
    words
      .slice(
        0,
        words.findIndex((one) => one.word === word),
      )
      .reduce((sum, { parts }) => sum + parts, 0);
  const shown = wanted.flatMap(({ found, how }, k): readonly HistogramContent[] => {
    const { columns } = found.channel.info;
    const column = columns[found.column];
    const figures = list[firstOf(how.word) + how.part]?.figures;
    if (!figures || !column) return [];
    return [{ name: column.label || column.name, colour: colourOf(column.name, k), bins: binsOf(figures, how) }];
  });
  const unit = wanted[0] ? unitOf(wanted[0].found) : "";
  return { ok: true as const, value: { shown, unit } };
}

interface ViewProps {
  readonly deps: Deps;
  readonly latest: LatestAnswer<Content>;
  readonly question: Signal<string>;
  readonly lost: Signal<string>;
}

function View({ deps, latest, question, lost }: ViewProps) {
  const { viewState, store } = deps;
  void [store.channels.value, viewState.device.value];
  const choice = viewState.histogram.value;
  const channels = countable(channelsOf(deps));
  const channel = chosenChannel(channels, choice);
  if (channel === undefined) return <p class="foot-note dim">{TEXT.noSignals}</p>;
  return (
    <>
      <HistogramTools viewState={viewState} channels={channels} channel={channel} />
      {lost.value !== "" ? (
        <p class="foot-note dim">{lost}</p>
      ) : (
        <Answered of={latest.of(question.value)} waiting={<p class="foot-note dim">{TEXT.loading}</p>}>
          {(answer) => (
            <>
              <HistogramChart
                shown={answer.shown}
                unit={answer.unit}
                isDensity={choice.scale === "density"}
                hasCurve={choice.noCurve !== true}
              />
              <Figures answered={answer} />
            </>
          )}
        </Answered>
      )}
    </>
  );
}

function Figures({ answered: { shown, unit } }: { readonly answered: Content }) {
  const notes = [...new Set(shown.flatMap(({ bins }) => bins.notes))];
  return (
    <div class="histogram-figures" role="group" aria-label={TEXT.table} tabIndex={0}>
      <table>
        <TableHead
          of={[
            { text: <span class="visually-hidden">{TEXT.signal}</span> },
            ...[TEXT.samples, TEXT.mean, TEXT.least, TEXT.greatest, TEXT.binWidth].map((text) => ({
              text,
              class: "num",
            })),
            { text: TEXT.outside, class: "num", title: TEXT.outsideHint },
          ]}
        />
        <tbody>
          {shown.map(({ name, colour, bins }) => (
            <tr key={name}>
              <th scope="row" class={colour}>
                {name}
              </th>
              <td class="num">{number(bins.n, 0)}</td>
              <td class="num">
                {figure(bins.mean, 6)} ± {figure(bins.sigma)} <span class="unit">{unit}</span>
              </td>
              <td class="num">
                {figure(bins.min, 6)} <span class="unit">{unit}</span>
              </td>
              <td class="num">
                {figure(bins.max, 6)} <span class="unit">{unit}</span>
              </td>
              <td class="num">
                {figure(bins.width)} <span class="unit">{unit}</span>
              </td>
              <td class="num">
                ▼ {number(bins.below, 0)} ▲ {number(bins.above, 0)}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      {shown.map(({ name, bins }) =>
        clippedIn(bins) > 0 ? (
          <p key={name} class="mid text-xs">
            ▲ {name}: {TEXT.clipped(clippedIn(bins))}
          </p>
        ) : null,
      )}
      {notes.map((note) => (
        <p key={note} class="mid text-xs">
          {note}
        </p>
      ))}
    </div>
  );
}

export const mountHistogram = (host: HTMLElement, deps: Deps): Panel => new Histogram(host, deps);

const BINS = [0, 10, 20, 50, 100, 200, 500, 1000];
const WITHIN = [0, 3, 4, 5, 6];

interface Props {
  readonly viewState: ViewState;
  readonly channels: readonly Channel[];
  readonly channel: Channel;
}

/** The choices of the histogram: quantity, signals, range, scale, bins, and the values shown. */
function HistogramTools({ viewState, channels, channel }: Props) {
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
