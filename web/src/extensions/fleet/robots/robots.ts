/** All robots of a fleet as this page knows them, from answers that hold what changed. Pure. */
import { type Health, healthOf, worstDevice } from "./conditions";
import { byName } from "./order";
import type { FleetRobots, RobotDevice, RobotSummary } from "../../../wire/routes";

/** A robot with what follows from its summary; a new object whenever the summary changes. */
export interface Robot {
  readonly summary: RobotSummary;
  readonly health: Health;
  /** The device that its row shows. */
  readonly device: RobotDevice | undefined;
  /** What a search looks in, in lower case. */
  readonly text: string;
}

export function robotOf(summary: RobotSummary): Robot {
  const devices = summary.devices.flatMap((one) => [one.name, one.product, one.serial_number, one.firmware, one.fix]);
  const alarms = summary.alarms.map(({ name }) => name);
  const text = [summary.name, summary.group, summary.version, summary.address, ...devices, ...alarms]
    .join("\n")
    .toLowerCase();
  return { summary, health: healthOf(summary), device: worstDevice(summary), text };
}

export class Robots {
  /** By name. */
  readonly all = new Map<string, Robot>();
  /** Robots that left the fleet, for the rows that still stand on screen. */
  readonly gone = new Map<string, Robot>();
  #revision: number | undefined;
  /** Names in order, until one comes or goes. */
  #names: readonly string[] | undefined;

  /** To be asked for what came after; undefined: everything. */
  get revision(): number | undefined {
    return this.#revision;
  }

  namesInOrder(): readonly string[] {
    this.#names ??= [...this.all.keys()].sort(byName);
    return this.#names;
  }

  /** The robot of a row, also if it has left. */
  get(name: string): Robot | undefined {
    return this.all.get(name) ?? this.gone.get(name);
  }

  /**
   * Takes over an answer. One that says nothing new is passed over, in whatever order answers come.
   *
   * @param after the revision that was asked with
   * @returns false if something between what is known and this answer is missing: then everything is to be asked for
   */
  apply(answer: FleetRobots, after: number | undefined): boolean {
    if (answer.complete) {
      const named = new Set(answer.robots.map(({ name }) => name));
      for (const name of this.all.keys()) if (!named.has(name)) this.#remove(name);
    } else {
      const known = this.#revision;
      if (known === undefined || after === undefined || after > known || answer.revision < after) return false;
      if (answer.revision <= known) return true;
      for (const name of answer.gone) this.#remove(name);
    }
    for (const summary of answer.robots) {
      this.gone.delete(summary.name);
      if (!this.all.has(summary.name)) this.#names = undefined;
      this.all.set(summary.name, robotOf(summary));
    }
    this.#revision = answer.revision;
    return true;
  }

  #remove(name: string): void {
    const robot = this.all.get(name);
    if (robot) this.gone.set(name, robot);
    this.all.delete(name);
    this.#names = undefined;
  }
}
