/** The settings that a device had while it was recorded: as they were read, and beside those that it has now. */
import { signal } from "@preact/signals";
import { view } from "../../data/view";
import { dateWords, titleOf } from "../../recordings/listing";
import type { Replay } from "../../recordings/replay";
import { count } from "../../ui/format";
import { Dialog } from "../../ui/dialog";
import { Icon } from "../../ui/icons";
import type { DeviceInfo } from "../../wire/types";
import { type App, run } from "../app";
import { server } from "../configure/server";
import { go } from "../route";

const open = signal(false);

type Fields = Readonly<Record<string, unknown>>;

/** What server/library/taking.py writes of a device; of a file that says otherwise nothing is shown. */
interface Settings {
  readonly values: Readonly<Record<string, Fields>>;
  readonly missing: Readonly<Record<string, string>>;
  readonly about: Readonly<Record<"protocol" | "product" | "serial_number" | "firmware" | "reason", string>>;
  readonly taken: number | null;
}

const isFields = (value: unknown): value is Fields => typeof value === "object" && value !== null && !Array.isArray(value);
const words = (value: unknown): string => (typeof value === "string" ? value : "");

function settingsOf(replay: Replay, device: string | undefined): Settings | undefined {
  const told = replay.detail.snapshots[device ?? ""];
  if (!told || !isFields(told["values"])) return undefined;
  const values = Object.fromEntries(Object.entries(told["values"]).filter((pair): pair is [string, Fields] => isFields(pair[1])));
  if (Object.keys(values).length === 0) return undefined;
  const missing = isFields(told["missing"]) ? Object.fromEntries(Object.entries(told["missing"]).map(([name, why]) => [name, words(why)])) : {};
  const of = (name: string): string => words(told[name]);
  const about = { protocol: of("protocol"), product: of("product"), serial_number: of("serial_number"), firmware: of("firmware"), reason: of("reason") };
  return { values, missing, about, taken: typeof told["taken"] === "number" ? told["taken"] : null };
}

/** The device itself, where it is here now. */
function presentOf(app: App, { about }: Settings): DeviceInfo | undefined {
  const same = app.store.devices.value.filter(({ protocol, status, link }) => protocol === about.protocol && status === "live" && link !== "file");
  return same.find(({ serial_number: serial }) => about.serial_number !== "" && serial === about.serial_number) ?? (about.serial_number === "" ? same[0] : undefined);
}

/** "OutputConfiguration" → "Output configuration". */
function spaced(name: string): string {
  const text = name.replace(/_/g, " ").replace(/([a-z])([A-Z])/g, (_, a: string, b: string) => `${a} ${b.toLowerCase()}`);
  return text.charAt(0).toUpperCase() + text.slice(1);
}

function said(value: unknown): string {
  if (Array.isArray(value)) return value.map(said).join(value.some((one) => typeof one === "object") ? "\n" : ", ");
  if (isFields(value)) return Object.entries(value).map(([name, inside]) => `${name.replace(/_/g, " ")} ${said(inside)}`).join(", ");
  return value === null ? "none" : String(value).replace(/^-(?=\d)/, "−");
}

/** A line of the rail; nothing where no settings were recorded. */
export function SettingsLine({ replay }: { readonly replay: Replay }) {
  const settings = settingsOf(replay, view.value.device);
  if (!settings) return null;
  return (
    <div class="assettings">
      <span>Settings</span>
      <button type="button" class="btn edge" title="What the device was set to when this was recorded" onClick={() => (open.value = true)}>
        <Icon name="sliders" />
        As recorded
      </button>
    </div>
  );
}

export function SettingsDialog({ replay, app }: { readonly replay: Replay; readonly app: App }) {
  const settings = open.value ? settingsOf(replay, view.value.device) : undefined;
  if (!settings) return null;
  const present = presentOf(app, settings);
  const { about, taken } = settings;
  const close = (): void => {
    open.value = false;
  };
  const compare = async (to: DeviceInfo): Promise<void> => {
    const kept = await run(server.keepSnapshot(to.id, `Recording ${titleOf(replay.detail.info)}`.slice(0, 120), asText(settings)));
    close();
    if (kept) go("configure", to.id, "compare", kept.name);
  };
  return (
    <Dialog title="Settings as recorded" onClose={close}>
      <div class="recset">
        <p class="dim">
          {[about.product, about.serial_number, about.firmware && `firmware ${about.firmware}`, about.reason, taken !== null && `${dateWords(taken, true)} UTC`].filter(Boolean).join(" · ")}
        </p>
        {present ? (
          <button type="button" class="btn main" title="They are kept as a snapshot of the device, and shown beside what it has now" onClick={() => void compare(present)}>
            <Icon name="sliders" />
            Compare with {present.name} now
          </button>
        ) : (
          <p class="hint">The device is not connected: with it they can be compared with what it has now, and written to it again.</p>
        )}
        <dl>
          {Object.entries(settings.values).map(([name, fields]) => (
            <div key={name}>
              <dt>{spaced(name)}</dt>
              <dd>
                {Object.entries(fields).map(([field, value]) => (
                  <span key={field}>
                    {Object.keys(fields).length > 1 && <small>{field.replace(/_/g, " ")}</small>} {said(value)}
                  </span>
                ))}
              </dd>
            </div>
          ))}
        </dl>
        {Object.keys(settings.missing).length > 0 && <p class="hint">{count(Object.keys(settings.missing).length, "setting")} could not be read: {Object.keys(settings.missing).map(spaced).join(", ")}.</p>}
      </div>
    </Dialog>
  );
}

/** As a snapshot's file (server/control/snapshots.py): JSON is YAML. */
function asText({ values, missing, about, taken }: Settings): string {
  const { reason: _, ...rest } = about;
  return JSON.stringify({ imuscope: 1, title: "", taken: new Date(1000 * (taken ?? 0)).toISOString(), reason: "", ...rest, pinned: false, settings: values, missing });
}
