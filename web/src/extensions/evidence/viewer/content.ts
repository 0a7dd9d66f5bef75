/** Content of the file: read from its JSON and binary blocks (server/extensions/evidence/series.py writes them). */
import { niceStep } from "../../../charts/scale";
import { decimalsOf } from "../../../ui/format/format";

interface BlockRef {
  readonly block: number;
  readonly type: "f4" | "f8" | "u4";
}

interface SeriesContent {
  readonly label: string;
  readonly colour: string;
  readonly dash: readonly number[];
  readonly decimals: number;
  readonly period: number;
  readonly n: number;
  readonly step: number;
  readonly t: BlockRef;
  readonly v?: BlockRef;
  readonly low?: BlockRef;
  readonly high?: BlockRef;
  readonly interval?: number;
  readonly breaks: readonly number[];
}

interface PlotContent {
  readonly title: string;
  readonly unit: string;
  readonly low: number | null;
  readonly high: number | null;
  /** Absent in files of earlier versions. */
  readonly log?: boolean;
  readonly series: readonly SeriesContent[];
}

export interface Content {
  readonly t0: number;
  readonly t1: number;
  readonly cursors: { readonly a: number | null; readonly b: number | null };
  readonly plots: readonly PlotContent[];
  readonly events: readonly { readonly kind: string; readonly t0: number | null; readonly t1: number | null }[];
  readonly notes: { readonly times: readonly { readonly time: number }[] };
}

type Values = Float32Array | Float64Array;

/** A curve; times are seconds from the beginning of the range, so that they keep their precision. */
export interface EmbeddedCurve {
  readonly label: string;
  readonly colour: string;
  readonly dash: readonly number[];
  readonly decimals: number;
  readonly period: number;
  readonly times: Float64Array;
  /** Least and greatest value of each row; one array where every sample is in the file. */
  readonly low: Values;
  readonly high: Values;
  readonly isExact: boolean;
  /** Rows before which samples are missing. */
  readonly breaks: ReadonlySet<number>;
}

export interface EmbeddedPlot {
  readonly title: string;
  readonly unit: string;
  readonly fixed: readonly [number, number] | undefined;
  /** The y axis is logarithmic, as long as every value in the window is positive. */
  readonly isLog: boolean;
  readonly curves: readonly EmbeddedCurve[];
}

const TICKS = 2 ** 32 - 1;
const LEAST_TICK_S = 1e-7;

/** Length of a tick, as in server/extensions/evidence/series.py. */
export function tickOf(span: number): number {
  return niceStep(Math.max(span / TICKS, LEAST_TICK_S));
}

/** Bytes of base64. */
export function embeddedBytes(text: string): ArrayBuffer {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let k = 0; k < binary.length; k++) bytes[k] = binary.charCodeAt(k);
  return bytes.buffer;
}

/** Plots of the content. `blockOf` gives the base64 of a block. */
export function embeddedPlots(content: Content, blockOf: (number: number) => string): readonly EmbeddedPlot[] {
  const tick = tickOf(content.t1 - content.t0);
  const known = new Map<number, ArrayBuffer>();
  const times = new Map<number, Float64Array>();
  const buffer = (number: number): ArrayBuffer => {
    const found = known.get(number) ?? embeddedBytes(blockOf(number));
    known.set(number, found);
    return found;
  };
  const values = ({ block, type }: BlockRef): Values =>
    type === "f8" ? new Float64Array(buffer(block)) : new Float32Array(buffer(block));
  const timesOf = ({ block }: BlockRef): Float64Array => {
    const found = times.get(block) ?? Float64Array.from(new Uint32Array(buffer(block)), (ticks) => ticks * tick);
    times.set(block, found);
    return found;
  };
  return content.plots.map(({ title, unit, low, high, log, series }) => ({
    title,
    unit,
    fixed: low !== null && high !== null && low < high ? ([low, high] as const) : undefined,
    isLog: log === true,
    curves: series.flatMap((one) => {
      const [least, greatest] = [one.v ?? one.low, one.v ?? one.high];
      if (least === undefined || greatest === undefined) return [];
      return [
        {
          label: one.label,
          colour: one.colour,
          dash: one.dash,
          decimals: decimalsOf({ decimals: one.decimals, dtype: "f8", unit }),
          period: one.period,
          times: timesOf(one.t),
          low: values(least),
          high: values(greatest),
          isExact: one.v !== undefined,
          breaks: new Set(one.breaks),
        },
      ];
    }),
  }));
}
