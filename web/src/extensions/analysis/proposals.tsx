/** What a device has in the place of a signal that it has not. */
import type { Channel } from "../../data/channels";
import { Button } from "../../ui/controls/button";
import { signalNames } from "./figures";
import { TEXT } from "./texts";

const MAX_NAMES = 6;

/** Names of the device for what these words mean on any device: of the same quantity or unit, else all of its own. */
export function likeNames(
  words: readonly string[],
  device: string | undefined,
  channels: readonly Channel[],
): readonly string[] {
  const own = signalNames(channels, device);
  const found = words.flatMap((word) => {
    const meant = channels.find(({ info }) => word === info.name || word.startsWith(`${info.name}.`))?.info;
    if (!meant) return [];
    const { title, unit, name } = meant;
    return channels
      .map(({ info }) => info)
      .filter((one) => one.device === device && own.includes(one.name))
      .filter((one) => (title !== "" && one.title === title) || (unit !== "" && one.unit === unit))
      .map((one) => one.name + (one.columns.length > 1 ? word.slice(name.length) : ""));
  });
  return [...new Set(found.length > 0 ? found : own)].slice(0, MAX_NAMES);
}

interface Props {
  readonly names: readonly string[];
  readonly choose: (name: string) => void;
}

export function Proposals({ names, choose }: Props) {
  if (names.length === 0) return null;
  return (
    <p class="control-row" role="group" aria-label={TEXT.deviceHas}>
      {TEXT.deviceHas}
      {names.map((name) => (
        <Button key={name} look="small edge" words={name} onClick={() => choose(name)} />
      ))}
    </p>
  );
}
