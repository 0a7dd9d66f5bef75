/**
 * Door of the page for extensions of other packages: a module that the server passes on, `/extensions/NAME/index.js`, whose default
 * function is called with the door. Nothing else of the page is public; docs/add-an-extension.md describes it.
 *
 *     export default function (door) { door.addPanel({ id: "total/samples", title: "Samples", mount(host, view) { … } }); }
 */
import type { App, Deps } from "../../page/context";
import { channelsOf, reading, sampleAt, selected } from "../../panels/panel-context";
import { type PanelPlace, registerPanel } from "../../panels/registry";
import type { Panel } from "../../ui/dom/dom";
import { request } from "../../requests/http";
import { serverRoot } from "../../requests/server-place";
import { TEXT } from "./texts";
import type { InstalledExtension } from "../../wire/routes";

const VERSION = 1;

/** A signal of the selected device at the reading position. */
export interface SignalReading {
  readonly channel: string;
  readonly column: string;
  readonly unit: string;
  /** As displayed; NaN for a value that the device marked as missing. */
  readonly value: number;
  /** Unix s, on the clock that the plots show. */
  readonly time: number;
}

/** What a panel reads. */
export interface PackageView {
  /** True over a recording. */
  readonly isRecording: boolean;
  /** The selected device; undefined without one. */
  device(): { readonly id: string; readonly name: string; readonly protocol: string } | undefined;
  /** Its signals at the reading position: the newest samples while live, else those at the cursor. */
  signals(): readonly SignalReading[];
  /** A request to the server: "api/total". */
  fetch(path: string, init?: RequestInit): Promise<Response>;
}

export interface PackagePanel {
  /** Begins with the name of the extension: "total/samples". */
  readonly id: string;
  readonly title: string;
  /** Default: "below". */
  readonly where?: PanelPlace;
  readonly order?: number;
  readonly optional?: boolean;
  /** Builds the panel in `host`. `update` is called once a frame with its time in ms. */
  readonly mount: (host: HTMLElement, view: PackageView) => Partial<Panel> | undefined;
}

export interface PackageDoor {
  readonly version: number;
  addPanel(panel: PackagePanel): void;
}

/** Loads the parts of the page that installed packages bring. One that fails is shown as a problem, and stops nothing. */
export async function loadExtensionPackages(app: App): Promise<void> {
  const outcome = await request("GET /api/extensions");
  if (!outcome.ok) return; // an older server; the page itself shows a refusal
  await Promise.all(outcome.value.filter(({ module }) => module !== "").map((one) => load(app, one)));
}

async function load(app: App, { name, title, module }: InstalledExtension): Promise<void> {
  try {
    const address = new URL(`${serverRoot()}/${module}`, location.href).href;
    const { default: start } = (await import(/* @vite-ignore */ address)) as { default: (door: PackageDoor) => void };
    start(doorOf(name));
  } catch (error) {
    reportError(error);
    const message = TEXT.failed(title, String(error));
    app.problem.value = { kind: "extension", status: 0, message, hint: TEXT.failedHint };
  }
}

function doorOf(name: string): PackageDoor {
  return {
    version: VERSION,
    addPanel({ id, title, where = "below", order = 50, optional = false, mount }) {
      if (!id.startsWith(`${name}/`)) throw new Error(`the panel ${id} must begin with "${name}/"`);
      registerPanel({
        id,
        title,
        where,
        order,
        optional,
        readsCursor: true,
        mount(host, deps) {
          const panel = mount(host, viewOf(deps)) ?? {};
          return {
            update: (now) => panel.update?.(now),
            dispose() {
              panel.dispose?.();
              host.replaceChildren();
            },
          };
        },
      });
    },
  };
}

function viewOf(deps: Deps): PackageView {
  return {
    isRecording: deps.recording !== undefined,
    device() {
      const device = selected(deps);
      return device && { id: device.id, name: device.name, protocol: device.protocol };
    },
    signals() {
      const at = reading(deps);
      return channelsOf(deps).flatMap((channel) => {
        const i = sampleAt(channel, at);
        if (i < 0) return [];
        const time = at.base === "arrival" ? channel.ring.arrival(i) : channel.ring.time(i);
        return channel.info.columns.map(({ name, unit }, column) => ({
          channel: channel.info.name,
          column: name,
          unit,
          value: channel.ring.value(column, i),
          time,
        }));
      });
    },
    fetch: (path, init) => fetch(`${serverRoot()}/${path}`, init),
  };
}
