/** The picture of a histogram: the outline of each signal's bins, its normal curve, and what lies under the pointer. */
import { useSignal } from "@preact/signals";
import { type Axis, axisOf, figure, share } from "../../charts/axes";
import { Chart, chartClass, useChart, valueUnder } from "../../charts/chart";
import { type ChartArea, Crosshair } from "../../charts/grid";
import { type Bins, normal } from "./figures";
import { TEXT } from "./texts";

const MARGINS = { left: 60, right: 12, top: 18, bottom: 34 };
const CURVE_POINTS = 160;

export interface HistogramContent {
  readonly name: string;
  readonly colour: string;
  readonly bins: Bins;
}

interface Props {
  readonly shown: readonly HistogramContent[];
  readonly unit: string;
  readonly isDensity: boolean;
  readonly hasCurve: boolean;
  /** Of another range than wanted. */
}

export function HistogramChart({ shown, unit, isDensity, hasCurve }: Props) {
  const size = useChart(MARGINS);
  const { area } = size;
  const pointer = useSignal<number | undefined>(undefined);
  const x = axisOf(
    "linear",
    shown.flatMap(({ bins }) => [bins.edges[0] ?? NaN, bins.edges.at(-1) ?? NaN]),
  );
  const values = (bins: Bins): readonly number[] => (isDensity ? bins.density : bins.counts);
  const tallest = Math.max(0, ...shown.flatMap(({ bins }) => values(bins)));
  const y: Axis = { kind: "linear", low: 0, high: tallest > 0 ? tallest * 1.05 : 1 };
  return (
    <div
      class={chartClass("histogram-chart")}
      ref={size.host}
      onPointerMove={(event) => (pointer.value = valueUnder(size, x, event))}
      onPointerLeave={() => (pointer.value = undefined)}
    >
      {x && (
        <Chart
          size={size}
          label={TEXT.chart(shown.map(({ name }) => name).join(", "))}
          x={x}
          y={y}
          xTitle={unit}
          xTitleAt="end"
          yTitle={isDensity ? TEXT.densityAxis(unit) : TEXT.countAxis}
        >
          {shown.map(({ name, colour, bins }) => {
            const place = { x, y, ...area };
            const scale = isDensity ? 1 : bins.n * bins.width;
            return (
              <g key={name} class={colour}>
                <path class="bins" d={outline(bins.edges, values(bins), place)} />
                {hasCurve && bins.sigma > 0 && <path class="normal" d={bell(bins, scale, place)} />}
              </g>
            );
          })}
          {pointer.value !== undefined && <Crosshair x={share(x, pointer.value) * area.width} {...area} />}
        </Chart>
      )}
      <Reading shown={shown} at={pointer.value} unit={unit} values={values} />
    </div>
  );
}

interface Place extends ChartArea {
  readonly x: Axis;
  readonly y: Axis;
}

function outline(edges: readonly number[], values: readonly number[], { x, y, width, height }: Place): string {
  const px = (value: number | undefined): string => (share(x, value ?? NaN) * width).toFixed(1);
  const py = (value: number | undefined): string => ((1 - share(y, value ?? NaN)) * height).toFixed(1);
  if (edges.length === 0) return "";
  const steps = values.map((value, k) => ["V", py(value), "H", px(edges[k + 1])].join(""));
  return ["M", px(edges[0]), " ", py(0), ...steps, "V", py(0), "Z"].join("");
}

function bell({ edges, mean, sigma }: Bins, scale: number, { x, y, width, height }: Place): string {
  const [low, high] = [edges[0] ?? NaN, edges.at(-1) ?? NaN];
  return Array.from({ length: CURVE_POINTS + 1 }, (_, k) => {
    const value = low + (k / CURVE_POINTS) * (high - low);
    const top = (1 - share(y, scale * normal(value, mean, sigma))) * height;
    return `${k === 0 ? "M" : "L"}${(share(x, value) * width).toFixed(1)} ${Math.max(-MARGINS.top, top).toFixed(1)}`;
  }).join("");
}

interface ReadingProps {
  readonly shown: readonly HistogramContent[];
  readonly at: number | undefined;
  readonly unit: string;
  readonly values: (bins: Bins) => readonly number[];
}

/** The bin of each signal under the pointer. */
function Reading({ shown, at, unit, values }: ReadingProps) {
  if (at === undefined) return null;
  return (
    <p class="chart-reading histogram-reading">
      {shown.map(({ name, colour, bins }) => {
        const k = Math.floor((at - (bins.edges[0] ?? NaN)) / bins.width);
        const value = values(bins)[k];
        if (value === undefined) return null;
        return (
          <span key={name}>
            <i class={colour}>{name}</i> {TEXT.binReading(figure(bins.edges[k]), figure(bins.edges[k + 1]), unit)}:{" "}
            {figure(value)}
          </span>
        );
      })}
    </p>
  );
}
