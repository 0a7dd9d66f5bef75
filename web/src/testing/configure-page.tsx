/** The real Configure page of a recorded device, with the real store, in a DOM without a browser. */
import { cleanup, render, waitFor } from "@testing-library/preact";
import { afterEach, vi } from "vitest";
import type { Store } from "../data/store";
import type { Forms, SnapshotBody } from "../forms/types";
import type { DeviceJobs } from "../wire/types";
import { type Answers, type Asked, answering, type Family, feed, recorded } from "./recorded";

export interface Opened {
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
}

afterEach(cleanup); // effects that wait for a frame do not outlive the test

/** Opens the page, without module state of an earlier one. */
export async function openConfigure(
  family: Family,
  { place = "", unread = false, answers = {}, slow = "" }: Options = {},
): Promise<Opened> {
  cleanup();
  vi.resetModules();
  const known = recorded(family);
  const all = { ...known.answers, ...(unread ? known.unread : {}), ...answers };
  const asked = answering(all, slow);
  location.hash = `#/configure/1/${place}`;
  const { startApp } = await import("../pages/app-state");
  const { startRoute } = await import("../pages/route");
  const { createViewState } = await import("../data/view-state");
  const { RecentHealth } = await import("../panels/health-history");
  const { Store: RealStore } = await import("../data/store");
  const { default: ConfigurePage } = await import("../pages/configure/page");
  const { default: Decks } = await import("../pages/configure/rollback-banner");
  const store = new RealStore();
  const app = startApp({ store, viewState: createViewState(), recentHealth: new RecentHealth() });
  startRoute();
  feed(store, known, unread ? known.texts : (known.read ?? known.texts));
  render(
    <>
      <ConfigurePage app={app} />
      <Decks store={store} />
    </>,
  );
  await waitFor(() => {
    if (document.querySelector(".categories a") === null) throw new Error("the forms are not there");
  });
  return {
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
