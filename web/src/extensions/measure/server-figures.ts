/**
 * Figures from the server, for a range of which the page holds only some of the samples.
 *
 *     want(range, series) ── range stands still ──▶ POST /api/analysis/statistics ──▶ of(series)
 */
import { inFrame } from "../../data/frames";
import { type FigureSource, type MeasuredRange, type Wanted, wantedOf } from "../../measure/figure-source";
import type { Series } from "../../plots/plot-selection";
import { type Outcome, type HttpProblem, request } from "../../ui/http";
import type { AnalysisRequest, SignalFigures } from "../../wire/routes";
import { NO_FIGURES, type RangeFigures } from "./range-figures";

const finite = (value: unknown): number => (typeof value === "number" ? value : NaN);

/** Figures of a column as displayed, from those of the column as sent. */
export function displayed(figures: SignalFigures["figures"], { factor, offset, period }: Wanted): RangeFigures {
  const of = (key: string): number => finite(figures[key]);
  const size = Math.abs(factor);
  const moved = offset !== 0 && period > 0; // what is at the edge of the circle is elsewhere on it
  const ends = [of("min"), of("max")].map((v) => (moved ? NaN : factor * v + offset));
  if (factor < 0) ends.reverse();
  const [min = NaN, max = NaN] = ends; // of an angle the ends of its arc: max may be the smaller number
  return {
    n: of("n"),
    mean: inFrame({ terms: [[0, factor]], offset }, () => of("mean"), period),
    sigma: size * of("sigma"),
    rms: offset === 0 ? size * of("rms") : NaN,
    min,
    max,
    peakToPeak: size * of("peak_to_peak"),
    slope: factor * of("slope"),
    integral: offset === 0 ? factor * of("integral") : NaN,
    gaps: of("gaps"),
  };
}

/** A range is asked for after it has stood still for this long, ms, and a moving one this often. */
const REST_MS = 150;
const MOVING_MS = 600;
const PATIENCE_MS = 3000;

type Ask = (body: AnalysisRequest, signal: AbortSignal) => Promise<Outcome<unknown>>;
const askServer: Ask = (body, signal) =>
  request("POST /api/analysis/{name}", { path: { name: "statistics" }, body, signal });

/** Figures of signals as sent, by word and part. */
type Answers = ReadonlyMap<string, SignalFigures["figures"]>;
const keyOf = ({ t0, t1, base }: MeasuredRange): string => `${t0} ${t1} ${base}`;

/** The answer for a signal without a sample in the range. */
const empty = ({ word, parts }: Wanted): Answers =>
  new Map(Array.from({ length: parts }, (_, part) => [`${word} ${part}`, { n: 0, gaps: 0 }]));

export class ServerFigures {
  readonly #stop = new AbortController();
  #held: { readonly range: string; readonly stamp: string; readonly answers: Answers } | undefined;
  #wanted = "";
  #since = 0;
  #began = -Infinity;
  #notBefore = -Infinity;
  #busy = false;
  /** Of the last answer. */
  problem: HttpProblem | undefined;

  /** @param ask another one in tests */
  constructor(
    readonly source: FigureSource,
    readonly ask: Ask = askServer,
  ) {}

  /** Ask for these series over a range; call it repeatedly, `now` in ms. */
  want(series: readonly Series[], range: MeasuredRange, now: number): void {
    const wanted = series.flatMap((one) => wantedOf(one, this.source) ?? []);
    const words = [...new Map(wanted.map((one) => [one.word, one])).values()];
    const stamp = `${keyOf(range)} ${words.map(({ word }) => word).join(" ")}`;
    if (stamp !== this.#wanted) this.#since = now;
    this.#wanted = stamp;
    if (words.length === 0 || stamp === this.#held?.stamp || this.#busy || now < this.#notBefore) return;
    if (now - this.#since < REST_MS && now - this.#began < MOVING_MS) return;
    this.#began = now;
    this.#busy = true;
    void this.#fetch(words, range)
      .then((answers) => {
        if (answers !== undefined) this.#held = { range: keyOf(range), stamp, answers };
        else this.#notBefore = now + PATIENCE_MS;
      })
      .finally(() => (this.#busy = false));
  }

  /** Figures of a series over that range; undefined until known. */
  of(series: Series, range: MeasuredRange): RangeFigures | undefined {
    const wanted = wantedOf(series, this.source);
    if (wanted === undefined) return NO_FIGURES;
    if (this.#held?.range !== keyOf(range)) return undefined;
    const found = this.#held.answers.get(`${wanted.word} ${wanted.part}`);
    return found && displayed(found, wanted);
  }

  dispose(): void {
    this.#stop.abort();
  }

  /** One request for all; if one of them has no sample there, one for each. */
  async #fetch(words: readonly Wanted[], range: MeasuredRange): Promise<Answers | undefined> {
    const whole = await this.#request(words, range);
    if (whole.ok) return whole.value;
    this.problem = whole.problem;
    if (whole.problem.kind !== "not-found") return undefined;
    const each = await Promise.all(
      words.map(async (one) => ({ one, outcome: await this.#request([one], range) }) as const),
    );
    const problems = each.flatMap(({ outcome }) => (outcome.ok ? [] : [outcome.problem]));
    this.problem = problems.find(({ kind }) => kind !== "not-found");
    if (this.problem !== undefined) return undefined;
    return new Map(each.flatMap(({ one, outcome }) => [...(outcome.ok ? outcome.value : empty(one))]));
  }

  async #request(words: readonly Wanted[], range: MeasuredRange): Promise<Outcome<Answers>> {
    const body = { source: this.source.id, signals: words.map(({ word }) => word), ...range, options: {} };
    const outcome = await this.ask(body as AnalysisRequest, this.#stop.signal);
    if (!outcome.ok) return outcome;
    this.problem = undefined;
    const list = outcome.value as readonly SignalFigures[];
    let at = 0;
    const pairs = words.flatMap(({ word, parts }) =>
      Array.from({ length: parts }, (_, part) => [`${word} ${part}`, list[at++]?.figures ?? {}] as const),
    );
    return { ok: true, value: new Map(pairs) };
  }
}
