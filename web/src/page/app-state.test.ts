// @vitest-environment happy-dom
/** The device that is shown, while devices come and go. */
import { expect, test } from "vitest";
import { newApp } from "../testing/live-page";
import type { DeviceInfo } from "../wire/types";
import { select } from "./app-state";
import type { App } from "./context";

const shown = ({ viewState }: App): string | undefined => viewState.view.value.device;
const tell = ({ store }: App, ids: readonly string[]): void => {
  const devices = ids.map((id) => ({ id, parent: id.includes(".") ? id.split(".")[0] : "" }) as DeviceInfo);
  store.receive({ kind: "text", text: { op: "devices", devices } });
};

test("a further device of a link is shown again once a server that was started again knows it", () => {
  const app = newApp();
  tell(app, ["1", "2", "2.1"]);
  expect(shown(app)).toBe("1");
  select(app, "2.1");
  tell(app, ["1", "2"]);
  expect(shown(app)).toBe("2"); // the same link meanwhile
  tell(app, ["1", "2", "2.1"]);
  expect(shown(app)).toBe("2.1");
  tell(app, ["1", "2"]);
  select(app, "1");
  tell(app, ["1", "2", "2.1"]);
  expect(shown(app)).toBe("1"); // chosen meanwhile
  select(app, "2.1");
  tell(app, ["1"]); // removed with its link
  expect(shown(app)).toBe("1");
  tell(app, ["1", "2", "2.1"]);
  expect(shown(app)).toBe("1");
});
