/** The choices of the XY plot: both signals, range, time as colour or trail, lines or points, scale, and how signals are paired. */
import { Button } from "../../ui/controls/button";
import type { ViewState } from "../../data/view-state";
import type { XyChoice } from "../../data/view";
import { channelsOf } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { type Found, unitOf } from "../../signals/custom-plots";
import { chosenPair, columnName, plottableOf, signalName, nameWithUnit } from "./choice";
import { ChartTools, Pair, RangeChoice } from "../../charts/tools";
import { TEXT } from "./texts";
import type { Channel } from "../../data/channels";
import { Icon } from "../../ui/controls/icons";

export function choose(
  { xy }: Pick<ViewState, "xy">,
  part: { readonly [name in keyof XyChoice]: XyChoice[name] | undefined },
) {
  const next = { ...xy.peek(), ...part };
  xy.value = Object.fromEntries(Object.entries(next).filter(([, value]) => value !== undefined));
}

export function XyTools({ deps }: { readonly deps: Deps }) {
  const { viewState } = deps;
  void [deps.store.channels.value, viewState.device.value];
  const signals = plottableOf(channelsOf(deps));
  const choice = viewState.xy.value;
  const pair = chosenPair(signals, choice);
  if (!pair) return <p class="foot-note dim">{TEXT.noSignals}</p>;
  const { x, y } = pair;
  const pick = (axis: "x" | "y") => (found: Found) => choose(viewState, { [axis]: columnName(found) });
  return (
    <ChartTools>
      <SignalSelect label={TEXT.y} signals={signals} value={y} onChange={pick("y")} />
      <Button
        look="icon"
        words="⇄"
        aria-label={TEXT.swap}
        title={TEXT.swap}
        onClick={() => choose(viewState, { x: columnName(y), y: columnName(x) })}
      />
      <SignalSelect label={TEXT.x} signals={signals} value={x} onChange={pick("x")} />
      <RangeChoice viewState={viewState} range={choice.range} onChange={(range) => choose(viewState, { range })} />
      <Pair
        label={TEXT.colour}
        names={[TEXT.byTime, TEXT.trail]}
        second={choice.colour === "trail"}
        onChange={(second) => choose(viewState, { colour: second ? "trail" : undefined })}
      />
      <Pair
        label={TEXT.draw}
        names={[TEXT.line, TEXT.points]}
        second={choice.draw === "points"}
        onChange={(second) => choose(viewState, { draw: second ? "points" : undefined })}
      />
      {x.channel !== y.channel && (
        <Pair
          label={TEXT.pairing}
          names={[TEXT.interpolated, TEXT.nearest]}
          second={choice.pairing === "nearest"}
          onChange={(second) => choose(viewState, { pairing: second ? "nearest" : undefined })}
        />
      )}
      {unitOf(x) === unitOf(y) && (
        <Button
          look="toggle"
          words={TEXT.equal}
          aria-pressed={choice.isEqual === true}
          title={TEXT.equalHint}
          onClick={() => choose(viewState, { isEqual: choice.isEqual ? undefined : true })}
        />
      )}
    </ChartTools>
  );
}

interface Props {
  readonly label: string;
  readonly signals: readonly Found[];
  readonly value: Found;
  readonly onChange: (found: Found) => void;
}

function SignalSelect({ label, signals, value, onChange }: Props) {
  const groups = new Map<Channel, Found[]>();
  for (const one of signals) groups.set(one.channel, [...(groups.get(one.channel) ?? []), one]);
  const at = (found: Found): string =>
    String(signals.findIndex(({ channel, column }) => channel === found.channel && column === found.column));
  return (
    <label class="chart-choice flex-row mid text-sm">
      <span aria-hidden="true">{label}</span>
      <span class="select">
        <select
          aria-label={label}
          value={at(value)}
          onChange={(event) => {
            const found = signals[Number(event.currentTarget.value)];
            if (found) onChange(found);
          }}
        >
          {[...groups].map(([channel, own]) =>
            own.length === 1 && own[0] ? (
              <option key={channel.info.id} value={at(own[0])}>
                {nameWithUnit(own[0])}
              </option>
            ) : (
              <optgroup key={channel.info.id} label={groupName(channel)}>
                {own.map((one) => (
                  <option key={one.column} value={at(one)}>
                    {own.every((other) => unitOf(other) === unitOf(one)) ? signalName(one) : nameWithUnit(one)}
                  </option>
                ))}
              </optgroup>
            ),
          )}
        </select>
        <Icon name="down" />
      </span>
    </label>
  );
}

function groupName({ info }: Channel): string {
  const title = info.title || info.name;
  return info.unit === "" ? title : `${title} (${info.unit})`;
}
