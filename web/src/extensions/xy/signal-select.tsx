/** A list of signals, by channel, of which one is chosen. */
import type { Channel } from "../../data/channels";
import { type Found, unitOf } from "../../signals/custom-plots";
import { Icon } from "../../ui/controls/icons";
import { signalName, nameWithUnit } from "./choice";

interface Props {
  readonly label: string;
  readonly signals: readonly Found[];
  readonly value: Found;
  readonly onChange: (found: Found) => void;
}

export function SignalSelect({ label, signals, value, onChange }: Props) {
  const groups = new Map<Channel, Found[]>();
  for (const one of signals) groups.set(one.channel, [...(groups.get(one.channel) ?? []), one]);
  const at = (found: Found): string =>
    String(signals.findIndex(({ channel, column }) => channel === found.channel && column === found.column));
  return (
    <label class="chart-choice">
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
