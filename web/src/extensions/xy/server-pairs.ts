/** Pairs from the server, for a range of which the page holds only some of the samples. */
import { inFrame } from "../../data/frames";
import { LatestAnswer } from "../../requests/latest-answer";
import { type FigureSource, type MeasuredRange, type Wanted, wantedOf } from "../../measure/figure-source";
import { type Found, unitOf } from "../../signals/custom-plots";
import { type Outcome, type HttpProblem, request } from "../../requests/http";
import type { PairsInfo, PairsRequest } from "../../wire/routes";
import { signalName } from "./choice";
import type { Pairing, Pairs } from "./pairs";
import { TEXT } from "./texts";

export interface WantedPairs {
  readonly x: Found;
  readonly y: Found;
  readonly how: Pairing;
  readonly range: MeasuredRange;
}

type Ask = (body: PairsRequest, signal: AbortSignal) => Promise<Outcome<PairsInfo>>;
const askServer: Ask = (body, signal) => request("POST /api/analysis/pairs", { body, signal });

const wordOf = ({ channel, column }: Found): string =>
  `${channel.info.id} ${channel.info.frame} ${channel.info.columns[column]?.name} ${unitOf({ channel, column })}`;
const signalsOf = ({ x, y, how }: WantedPairs): string => `${wordOf(x)} ${wordOf(y)} ${how}`;
const stampOf = (wanted: WantedPairs): string =>
  `${signalsOf(wanted)} ${wanted.range.t0} ${wanted.range.t1} ${wanted.range.base}`;

export class ServerPairs {
  readonly #source: FigureSource;
  readonly #ask: Ask;
  readonly #latest = new LatestAnswer<{ readonly signals: string; readonly pairs: Pairs }>();
  #problem: Pick<HttpProblem, "message"> | undefined;

  constructor(source: FigureSource, ask: Ask = askServer) {
    this.#source = source;
    this.#ask = ask;
  }

  get problem(): Pick<HttpProblem, "message"> | undefined {
    return this.#problem;
  }

  /** The newest pairs of these signals, and whether they are those of the range; asks for them. `now` in ms. */
  of(wanted: WantedPairs, now: number): { readonly pairs: Pairs; readonly isNewest: boolean } | undefined {
    const question = stampOf(wanted);
    const [x, y] = [wantedOf(wanted.x, this.#source), wantedOf(wanted.y, this.#source)];
    const unknown = x === undefined ? wanted.x : y === undefined ? wanted.y : undefined;
    if (x && y) this.#latest.want(question, now, (signal) => this.#request(wanted, x, y, signal));
    const { answer, isOld, problem } = this.#latest.of(question);
    this.#problem = unknown ? { message: TEXT.frameUnknown(signalName(unknown)) } : problem;
    // the axes are those of the signals as of now
    return answer?.signals === signalsOf(wanted) ? { pairs: answer.pairs, isNewest: !isOld } : undefined;
  }

  dispose(): void {
    this.#latest.dispose();
  }

  async #request(
    wanted: WantedPairs,
    x: Wanted,
    y: Wanted,
    signal: AbortSignal,
  ): Promise<Outcome<{ readonly signals: string; readonly pairs: Pairs }>> {
    const { t0, t1, base } = wanted.range;
    const outcome = await this.#ask(
      {
        source: this.#source.id,
        x: { signal: x.word, part: x.part },
        y: { signal: y.word, part: y.part },
        ...{ t0, t1, base, pairing: wanted.how },
      },
      signal,
    );
    if (!outcome.ok) return outcome;
    return { ok: true, value: { signals: signalsOf(wanted), pairs: pairsOf(outcome.value, x, y) } };
  }
}

/** The answer as displayed. */
function pairsOf(info: PairsInfo, x: Wanted, y: Wanted): Pairs {
  const starts = new Uint8Array(info.time.length);
  for (const at of info.starts) starts[at] = 1;
  const shown = (values: readonly number[], { factor, offset, period }: Wanted): readonly number[] =>
    factor === 1 && offset === 0
      ? values
      : values.map((value) => inFrame({ terms: [[0, factor]], offset }, () => value, period));
  const { leader, n, t0, time } = info;
  const ledBy = (wanted: Wanted): boolean => wanted.word === leader || wanted.word.endsWith(`/${leader}`);
  return {
    time: time.map((after) => t0 + after),
    x: shown(info.x, x),
    y: shown(info.y, y),
    starts,
    n,
    leader: leader === "" ? undefined : ledBy(y) ? "y" : "x",
  };
}
