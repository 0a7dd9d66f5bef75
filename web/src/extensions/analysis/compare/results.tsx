/** Figures of a comparison: statistics of the differences, spectra of both, and the settings of both. */
import { useSignal } from "@preact/signals";
import { figure } from "../../../charts/axes";
import { type ChartCurve, type CurveNumbers, FigureChart } from "../chart";
import { request } from "../../../requests/http";
import { Message } from "../../../ui/controls/message";
import { Answered, useAnswer } from "../../../requests/use-answer";
import type { ComparedSignal, Routes, SignalFigures } from "../../../wire/routes";
import { type CompareModel, type Ready, requestOf } from "./model";
import type { SideChoice } from "./sides";
import { TableHead } from "../../../ui/controls/table-head";
import { TEXT as ANALYSIS } from "../texts";
import { TEXT } from "./texts";

const FIGURES = ["mean", "sigma", "rms", "min", "max"] as const;
const shown = (value: number | null | undefined, unit: string): string => `${figure(value)} ${unit}`.trim();

/** Attitudes of two filters differ by this much at rest, °; more than that is no fixed rotation between the sensors. */
const MOST_REMAINING = 5;

const isFixed = ({ figures }: ComparedSignal): boolean => (figures["remaining"] ?? Infinity) <= MOST_REMAINING;

export function Statistics({ signals }: { readonly signals: readonly ComparedSignal[] }) {
  const rows = signals.filter(({ figures }) => figures["n"] !== undefined);
  const attitude = rows.find(({ figures }) => figures["mounting"] !== undefined);
  if (rows.length === 0) return null;
  return (
    <section aria-label={TEXT.statistics}>
      <h2>{TEXT.statistics}</h2>
      <div class="compare-table">
        <table>
          <TableHead
            of={[TEXT.quantity, ...[...FIGURES, "limits" as const, "n" as const].map((name) => TEXT.figure[name])]}
          />
          <tbody>
            {rows.map(({ signal, unit, a, figures }) => (
              <tr key={signal}>
                <th scope="row">{a === null ? TEXT.attitude : signal}</th>
                {FIGURES.map((name) => (
                  <td key={name}>{shown(figures[name], unit)}</td>
                ))}
                <td>{TEXT.to95(figure(figures["low"]), shown(figures["high"], unit))}</td>
                <td>{figures["n"]}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {attitude && (
        <p>
          {TEXT.mounting(shown(attitude.figures["mounting"], "°"), shown(attitude.figures["remaining"], "°"))}{" "}
          {isFixed(attitude) ? TEXT.mountingFits : TEXT.mountingUnfit}
        </p>
      )}
    </section>
  );
}

interface Props {
  readonly model: CompareModel;
  readonly wanted: Ready;
}

/** Power spectral densities of both sides, on request. */
export function Spectra({ model, wanted }: Props) {
  const isOpen = useSignal(false);
  return (
    <details onToggle={(event) => (isOpen.value = event.currentTarget.open)}>
      <summary>{TEXT.spectra}</summary>
      {isOpen.value && <BothSpectra model={model} wanted={wanted} />}
    </details>
  );
}

function BothSpectra({ model, wanted }: Props) {
  const { a, b, signals, signals_b: others = [] } = requestOf(model, wanted);
  const psd = (side: typeof a, names: readonly string[], signal: AbortSignal) => {
    const body = { ...side, signals: names, options: { scale: "amplitude" } };
    return request("POST /api/analysis/{name}", { path: { name: "psd" }, body, signal });
  };
  const key = JSON.stringify([wanted.a, wanted.b, signals, others]);
  const found = useAnswer<readonly SignalFigures[][]>(key, async (over) => {
    const both = [psd(a, signals, over), psd(b, others.length > 0 ? others : signals, over)] as const;
    const [first, second] = await Promise.all(both);
    if (!first.ok) return first;
    return second.ok ? { ok: true, value: [first.value, second.value] as SignalFigures[][] } : second;
  });
  return (
    <Answered of={found} waiting={<p aria-busy="true">{TEXT.computing}</p>}>
      {([first, second]) =>
        first?.map((one, i) => (
          <FigureChart
            key={one.signal}
            label={ANALYSIS.chart(TEXT.spectra, one.signal)}
            curves={[spectrum("A", "side-a", one), ...(second?.[i] ? [spectrum("B", "side-b", second[i])] : [])]}
            xKind="log"
            xTitle={ANALYSIS.frequency}
            xUnit="Hz"
            yTitle={one.signal}
            yUnit={one.units["psd"] ?? ""}
          />
        ))
      }
    </Answered>
  );
}

function spectrum(name: string, colour: string, { figures }: SignalFigures): ChartCurve {
  const of = (key: string): CurveNumbers => ((figures[key] as CurveNumbers | undefined) ?? []).slice(1);
  return { name, colour, x: of("frequency"), y: of("psd"), low: of("low"), high: of("high") };
}

/** Settings of both sides as a diff, on request. */
export function Settings({ wanted }: { readonly wanted: Ready }) {
  const isOpen = useSignal(false);
  return (
    <details onToggle={(event) => (isOpen.value = event.currentTarget.open)}>
      <summary>{TEXT.settings}</summary>
      {isOpen.value && <SettingsDiff wanted={wanted} />}
    </details>
  );
}

function SettingsDiff({ wanted }: { readonly wanted: Ready }) {
  const { a, b } = wanted;
  const whole = ({ source, device }: SideChoice) => ({ source, device, t0: null, t1: null });
  const body = { a: whole(a), b: whole(b) };
  const found = useAnswer(JSON.stringify(body), (signal) => request("POST /api/comparison/settings", { body, signal }));
  return (
    <Answered of={found} waiting={<p aria-busy="true">{TEXT.readingSettings}</p>}>
      {(difference) => <SettingsTable difference={difference} />}
    </Answered>
  );
}

type SettingsDiffAnswer = Routes["POST /api/comparison/settings"]["answer"];

function SettingsTable({ difference }: { readonly difference: SettingsDiffAnswer }) {
  const missing = Object.entries(difference.missing ?? {});
  return (
    <>
      <p role="status">
        <b>{difference.rows.length === 0 ? TEXT.noDifference : TEXT.differences(difference.rows.length)}</b>
        {TEXT.agree(difference.same)}
      </p>
      {difference.rows.length > 0 && (
        <div class="compare-table">
          <table>
            <TableHead
              of={[
                TEXT.setting,
                { text: difference.left, class: "side-a" },
                { text: difference.right, class: "side-b" },
              ]}
            />
            <tbody>
              {difference.rows.map((row) => (
                <tr key={`${row.setting} ${row.path}`}>
                  <th scope="row">{row.title}</th>
                  <td>{row.left || TEXT.missing}</td>
                  <td>{row.right || TEXT.missing}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
      {missing.length > 0 && (
        <>
          <p class="dim">{TEXT.notCompared(missing.length)}:</p>
          <ul class="dim">
            {missing.map(([name, reason]) => (
              <li key={name}>
                <span class="mono">{name}</span>: <Message text={reason} />
              </li>
            ))}
          </ul>
        </>
      )}
    </>
  );
}
