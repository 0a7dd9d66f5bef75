/**
 * Figures from the server, for a range of which the page holds only some of the samples.
 *
 *     want(range, series) ── range stands still ──▶ POST /api/analysis/statistics ──▶ of(series)
 */
import { inFrame } from "../../data/frames";
import { LatestAnswer } from "../../requests/latest-answer";
import { type FigureSource, type MeasuredRange, type Wanted, wantedOf } from "../../measure/figure-source";
import type { Series } from "../../data/view";
import { type Outcome, type HttpProblem, request } from "../../requests/http";
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

type Ask = (body: AnalysisRequest, signal: AbortSignal) => Promise<Outcome<unknown>>;
const askServer: Ask = (body, signal) =>
  request("POST /api/analysis/{name}", { path: { name: "statistics" }, body, signal });

/** Figures of signals as sent, by word and part. */
type Answers = ReadonlyMap<string, SignalFigures["figures"]>;
const keyOf = ({ t0, t1, base }: MeasuredRange): string => `${t0} ${t1} ${base}`;

/** The answer for a signal without a sample in the range. */
const empty = ({ word, parts }: Wanted): Answers =>
  new Map(Array.from({ length: parts }, (_, part) => [`${word} ${part}`, { n: 0, gaps: 0 }]));

interface Answered {
  readonly range: string;
  readonly answers: Answers;
}

export class ServerFigures {
  readonly #latest = new LatestAnswer<Answered>();
  #question = "";

  /** @param ask another one in tests */
  constructor(
    readonly source: FigureSource,
    readonly ask: Ask = askServer,
  ) {}

  get problem(): HttpProblem | undefined {
    return this.#latest.of(this.#question).problem;
  }

  /** Ask for these series over a range; call it repeatedly, `now` in ms. */
  want(series: readonly Series[], range: MeasuredRange, now: number): void {
    const wanted = series.flatMap((one) => wantedOf(one, this.source) ?? []);
    const words = [...new Map(wanted.map((one) => [one.word, one])).values()];
    if (words.length === 0) return;
    const question = `${keyOf(range)} ${words.map(({ word }) => word).join(" ")}`;
    this.#latest.want(question, now, (signal) => this.#fetch(words, range, signal));
    this.#question = question;
  }

  /** Figures of a series over that range; undefined until known. */
  of(series: Series, range: MeasuredRange): RangeFigures | undefined {
    const wanted = wantedOf(series, this.source);
    if (wanted === undefined) return NO_FIGURES;
    const { answer, isOld } = this.#latest.of(this.#question);
    const held = isOld || answer?.range !== keyOf(range) ? undefined : answer;
    const found = held?.answers.get(`${wanted.word} ${wanted.part}`);
    return found && displayed(found, wanted);
  }

  dispose(): void {
    this.#latest.dispose();
  }

  /** One request for all; if one of them has no sample there, one for each. */
  async #fetch(words: readonly Wanted[], range: MeasuredRange, signal: AbortSignal): Promise<Outcome<Answered>> {
    const isEmpty = (outcome: Outcome<Answers>): boolean => !outcome.ok && outcome.problem.kind === "not-found";
    const alone = async (one: Wanted): Promise<Outcome<Answers>> => {
      const outcome = await this.#request([one], range, signal);
      return isEmpty(outcome) ? { ok: true, value: empty(one) } : outcome;
    };
    const whole = await this.#request(words, range, signal);
    const parts = isEmpty(whole) ? await Promise.all(words.map(alone)) : [whole];
    const answers = new Map<string, SignalFigures["figures"]>();
    for (const outcome of parts) {
      if (!outcome.ok) return outcome;
      for (const [word, figures] of outcome.value) answers.set(word, figures);
    }
    return { ok: true, value: { range: keyOf(range), answers } };
  }

  async #request(words: readonly Wanted[], range: MeasuredRange, signal: AbortSignal): Promise<Outcome<Answers>> {
    const body = { source: this.source.id, signals: words.map(({ word }) => word), ...range, options: {} };
    const outcome = await this.ask(body as AnalysisRequest, signal);
    if (!outcome.ok) return outcome;
    const list = outcome.value as readonly SignalFigures[];
    let at = 0;
    const pairs = words.flatMap(({ word, parts }) =>
      Array.from({ length: parts }, (_, part) => [`${word} ${part}`, list[at++]?.figures ?? {}] as const),
    );
    return { ok: true, value: new Map(pairs) };
  }
}
