/** The real Configure page of a recorded device, with the real store, in a DOM without a browser. */
import { render, waitFor } from "@testing-library/preact";
import type { Store } from "../data/store";
import type { Forms, SnapshotBody } from "../wire/form-types";
import type { App } from "../page/context";
import type { DeviceJobs } from "../wire/types";
import { ConfigurePage } from "../pages/configure/page";
import { Decks } from "../pages/configure/rollback-banner";
import { newApp, startOver } from "./live-page";
import { type Answers, type Asked, answering, type Family, feed, keysOf, recorded } from "./recorded";

export interface Opened {
  readonly app: App;
  readonly store: Store;
  readonly forms: Forms;
  /** The device's values. */
  readonly values: SnapshotBody["values"];
  /** Every request so far. */
  readonly asked: readonly Asked[];
  /** To another place of this page. */
  readonly goTo: (place: string) => void;
  /** Sends jobs of the device, as the server would. */
  readonly tell: (jobs: Partial<DeviceJobs>) => void;
}

interface Options {
  readonly place?: string;
  /** The settings have not been read yet. */
  readonly unread?: boolean;
  /** Answers in place of the recorded ones. */
  readonly answers?: Answers;
  /** The end of the path whose answers come last. */
  readonly slow?: string;
  /** The token of the page may only look. */
  readonly isViewOnly?: boolean;
}

export async function openConfigure(
  family: Family,
  { place = "", unread = false, answers = {}, slow = "", isViewOnly = false }: Options = {},
): Promise<Opened> {
  startOver(`#/configure/1/${place}`);
  const known = recorded(family);
  const all = { ...known.answers, ...(unread ? known.unread : {}), ...answers };
  const asked = answering(all, slow, keysOf([...known.texts, ...(known.read ?? [])]));
  const app = newApp();
  const { store } = app;
  const texts = unread ? known.texts : (known.read ?? known.texts);
  const role = isViewOnly ? "view" : "control";
  feed(
    store,
    known,
    texts.map((text) => (text.op === "hello" ? { ...text, role } : text)),
  );
  render(
    <>
      <ConfigurePage app={app} />
      <Decks app={app} />
    </>,
  );
  await waitFor(() => {
    if (document.querySelector(".categories a") === null) throw new Error("the forms are not there");
  });
  return {
    app,
    store,
    forms: all["GET /api/devices/1/forms"] as Forms,
    values: (all["GET /api/devices/1/values"] as SnapshotBody).values,
    asked,
    goTo: (name) => {
      location.hash = `#/configure/1/${name}`;
      dispatchEvent(new HashChangeEvent("hashchange"));
    },
    tell: (jobs) => {
      const before = store.jobs.peek().get("1");
      if (before === undefined) throw new Error("no jobs were recorded");
      store.receive({ kind: "text", text: { op: "jobs", devices: [{ ...before, ...jobs }] } });
    },
  };
}
