/** Figures of an analysis as a person reads them: charts, tables, verdicts, notes, and what copies them. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { Button } from "../../ui/controls/button";
import { copyText } from "../../ui/dom/copy";
import { type HttpProblem, request } from "../../requests/http";
import { Message } from "../../ui/controls/message";
import { ProblemNote } from "../../requests/problem-note";
import type { AnalysisRequest, SignalFigures } from "../../wire/routes";
import { figure } from "../../charts/axes";
import { type ChartCurve, FigureChart } from "./chart";
import { curveName } from "../../charts/curve-colours";
import {
  signalsByUnit,
  analysisCsv,
  curvesOf,
  ends,
  type Name,
  notesOf,
  obstaclesOf,
  parametersOf,
  peaksOf,
  verdictsOf,
} from "./figures";
import { type PlotAxis, Spectrogram } from "./spectrogram";
import { TableHead } from "../../ui/controls/table-head";
import { COMMON } from "../../texts/common";
import { TEXT } from "./texts";

const MAX_MARKS = 6;
/** Texts for other programs, by analysis. */
const FORMATS: Readonly<Partial<Record<Name, readonly string[]>>> = { allan: ["kalibr", "vins", "robot_localization"] };

export interface Result {
  readonly name: Name;
  readonly figures: readonly SignalFigures[];
  /** The request, for the same figures as a text. */
  readonly body: AnalysisRequest;
}

interface ResultProps extends Result {
  /** Of the frequency axis. */
  readonly xKind: "linear" | "log";
  /** Over time, the axis is that of the plots. */
  readonly plots?: PlotAxis | undefined;
  /** An earlier result to compare with. */
  readonly pinned?: Result | undefined;
}

export function AnalysisResult({ name, figures, body, xKind, plots, pinned }: ResultProps) {
  if (figures.length === 0) return null;
  const [notes, obstacles] = [notesOf(figures), obstaclesOf(figures)];
  const before = pinned?.name === name ? pinned.figures : [];
  return (
    <>
      {obstacles.length > 0 && (
        <ul class="analysis-obstacles" aria-label={TEXT.obstacles}>
          {obstacles.map((sentence) => (
            <li key={sentence}>
              <Message text={sentence} />
            </li>
          ))}
        </ul>
      )}
      {name === "psd" &&
        signalsByUnit(figures, "psd").map((some) => (
          <Spectrum key={some[0]?.signal} figures={some} before={before} xKind={xKind} />
        ))}
      {name === "allan" &&
        signalsByUnit(figures, "adev").map((some) => (
          <AllanDeviation key={some[0]?.signal} figures={some} before={before} />
        ))}
      {name === "spectrogram" && figures.map((one) => <Spectrogram key={one.signal} figures={one} plots={plots} />)}
      {name === "statistics" && <Statistics figures={figures} before={before} />}
      {notes.length > 0 && (
        <ul class="bullets">
          {notes.map((note) => (
            <li key={note}>
              <Message text={note} />
            </li>
          ))}
        </ul>
      )}
      {obstacles.length === 0 && <Copy name={name} figures={figures} body={body} />}
    </>
  );
}

function Spectrum({ figures, before, xKind }: Compared & Pick<ResultProps, "xKind">) {
  const [first] = figures;
  if (!first) return null;
  return (
    <>
      <FigureChart
        label={TEXT.chart(TEXT.psd, named(figures))}
        curves={[...curvesOf("psd", figures), ...pinnedCurves("psd", figures, before)]}
        xKind={xKind}
        xTitle={TEXT.frequency}
        xUnit="Hz"
        yTitle={TEXT.density}
        yUnit={first.units["psd"] ?? ""}
        marks={figures
          .flatMap((one) => peaksOf(one))
          .slice(0, MAX_MARKS)
          .map((peak) => ({ x: peak.frequency, text: figure(peak.frequency) }))}
      />
      <p class="dim">
        {TEXT.basedOn(
          Number(first.figures["segments"]),
          Number(first.figures["length"]),
          figure(first.figures["rate"] as number),
        )}
        . {TEXT.band}
      </p>
      <Peaks figures={figures} />
    </>
  );
}

function AllanDeviation({ figures, before }: Compared) {
  const [first] = figures;
  if (!first) return null;
  return (
    <>
      <FigureChart
        label={TEXT.chart(TEXT.allan, named(figures))}
        curves={[...curvesOf("allan", figures), ...pinnedCurves("allan", figures, before)]}
        xKind="log"
        xTitle={TEXT.averagingTime}
        xUnit="s"
        yTitle={TEXT.deviation}
        yUnit={first.units["adev"] ?? ""}
      />
      <p class="dim">
        {TEXT.basedOnSamples(Number(first.figures["n"]), figure(first.figures["rate"] as number))}. {TEXT.band}{" "}
        {figures.some((one) => one.figures["model"] !== undefined) && TEXT.model}
        {first.figures["data_sheet"] !== undefined && ` ${TEXT.dataSheet}`}
      </p>
      <Verdicts figures={figures} />
      <Parameters figures={figures} />
    </>
  );
}

const named = (figures: readonly SignalFigures[]): string => figures.map(({ signal }) => signal).join(", ");

function Verdicts({ figures }: Figures) {
  const rows = figures.flatMap((one) => verdictsOf(one).map((verdict) => ({ verdict, signal: one.signal })));
  if (rows.length === 0) return null;
  return (
    <ul class="analysis-verdicts text-sm" aria-label={TEXT.verdicts}>
      {rows.map(({ verdict, signal }) => (
        <li key={`${signal} ${verdict.parameter}`} class={verdict.state}>
          <b>{TEXT.verdict[verdict.state]}</b>
          <span>
            <i>{curveName(signal)}</i> {verdict.words}
          </span>
        </li>
      ))}
    </ul>
  );
}

interface Figures {
  readonly figures: readonly SignalFigures[];
}

interface Compared extends Figures {
  /** Of the pinned result. */
  readonly before: readonly SignalFigures[];
}

/** Curves of a pinned result in the same unit: dashed and without intervals. */
function pinnedCurves(name: Name, figures: Figures["figures"], before: Figures["figures"]): readonly ChartCurve[] {
  const key = name === "psd" ? "psd" : "adev";
  const alike = before.filter(({ units }) => units[key] === figures[0]?.units[key]);
  return curvesOf(name, alike).map(({ name: of, colour, x, y }) => ({
    ...{ name: TEXT.pinnedCurve(of), colour: `${colour} pinned`, x, y },
  }));
}

function Peaks({ figures }: Figures) {
  const rows = figures.flatMap((one) => peaksOf(one).map((peak) => ({ peak, signal: one.signal, unit: one.units })));
  if (rows.length === 0) return <p>{TEXT.noPeaks}</p>;
  return (
    <Scroll label={TEXT.peaks}>
      <TableHead of={["", TEXT.frequency, TEXT.rms, TEXT.aboveFloor, TEXT.fundamental]} />
      <tbody>
        {rows.map(({ peak, signal, unit }) => (
          <tr key={`${signal} ${peak.frequency}`}>
            <th scope="row">{curveName(signal)}</th>
            <td>
              {figure(peak.frequency, 6)} ± {figure(peak.uncertainty, 2)} Hz
            </td>
            <td>
              {figure(peak.rms)} {unit["peaks.rms"] ?? ""}
            </td>
            <td>{TEXT.decibels(figure(peak.above_floor, 3))}</td>
            <td>{peak.harmonic_of === null ? "1" : TEXT.ofHarmonic(peak.order, figure(peak.harmonic_of))}</td>
          </tr>
        ))}
      </tbody>
    </Scroll>
  );
}

function Parameters({ figures }: Figures) {
  const rows = [...new Set(figures.flatMap((one) => Object.keys(parametersOf(one))))];
  if (rows.length === 0) return null;
  return (
    <BySignal
      label={TEXT.parameters}
      figures={figures}
      rows={rows}
      title={(name) => TEXT.parameter[name] ?? name}
      cell={(one, name) => {
        const parameter = parametersOf(one)[name];
        if (parameter === undefined) return "—";
        const { value, low, high } = parameter;
        const unit = one.units[`parameters.${name}.value`] ?? "";
        const [from, to] = ends(low, high);
        if (value <= 0) return TEXT.atMost(`${to} ${unit}`);
        return (
          <>
            {figure(value)} {unit}
            <small class="dim" title={TEXT.interval}>
              {" "}
              {from} … {to}
            </small>
          </>
        );
      }}
    />
  );
}

function Statistics({ figures: now, before }: Compared) {
  const figures = [...now, ...before.map((one) => ({ ...one, signal: TEXT.pinnedCurve(curveName(one.signal)) }))];
  return (
    <BySignal
      label={TEXT.statistics}
      figures={figures}
      rows={Object.keys(figures[0]?.figures ?? {}).filter((name) => name !== "notes")}
      title={(name) => TEXT.statistic[name] ?? name}
      cell={({ figures: of, units }, name) =>
        `${figure(of[name] as number | null, name === "n" ? 9 : 5)} ${units[name] ?? ""}`
      }
    />
  );
}

interface BySignalProps extends Figures {
  readonly label: string;
  readonly rows: readonly string[];
  readonly title: (row: string) => string;
  readonly cell: (of: SignalFigures, row: string) => ComponentChildren;
}

/** A table with a column for each signal. */
function BySignal({ label, figures, rows, title, cell }: BySignalProps) {
  return (
    <Scroll label={label}>
      <TableHead of={["", ...figures.map(({ signal }) => curveName(signal))]} />
      <tbody>
        {rows.map((row) => (
          <tr key={row}>
            <th scope="row">{title(row)}</th>
            {figures.map((one) => (
              <td key={one.signal}>{cell(one, row)}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </Scroll>
  );
}

function Scroll({ label, children }: { readonly label: string; readonly children: ComponentChildren }) {
  return (
    <div class="analysis-table" role="region" aria-label={label} tabIndex={0}>
      <table>{children}</table>
    </div>
  );
}

function Copy({ name, figures, body }: Result) {
  const said = useSignal("");
  const problem = useSignal<HttpProblem | undefined>(undefined);
  const copy = async (text: string): Promise<void> => {
    said.value = (await copyText(text)) ? COMMON.copied : COMMON.notCopied;
  };
  const copyAs = async (format: string): Promise<void> => {
    const outcome = await request("POST /api/analysis/{name}", { path: { name }, body: { ...body, format } });
    problem.value = outcome.ok ? undefined : outcome.problem;
    if (outcome.ok) await copy(outcome.value as unknown as string);
  };
  return (
    <>
      <p class="analysis-row">
        {name !== "spectrogram" && (
          <Button look="edge" words={TEXT.copy} onClick={() => void copy(analysisCsv(name, figures))} />
        )}
        {FORMATS[name]?.map((format) => (
          <Button
            words={TEXT.copyAs(TEXT.format[format] ?? format)}
            key={format}
            look="edge"
            onClick={() => void copyAs(format)}
          />
        ))}
        <span role="status">{said.value}</span>
      </p>
      {problem.value && <ProblemNote problem={problem.value} />}
    </>
  );
}
