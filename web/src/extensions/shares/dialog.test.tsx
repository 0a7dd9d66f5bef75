// @vitest-environment happy-dom
/** The dialog of shared ports: who is there and who talks; a share is added and ended, a program disconnected. */
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { answering, type Asked } from "../../testing/recorded";
import type { SharedPort } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import type { App } from "../../page/context";
import { proposal, SharePort } from "./dialog";

const ROUTE = "/api/devices/1/shares";
const CLIENT = {
  number: 3,
  peer: "127.0.0.1:50312",
  name: "127.0.0.1:50312",
  limited: false,
  may_write: true,
  waits: false,
  sent: 1_234_000,
  received: 12,
  refused: 0,
  dropped_bytes: 0,
  dropped_frames: 0,
};
const EMPTY: SharedPort = {
  why_not: "",
  folder: "/run/imuscope",
  holder: 0,
  speaker: "",
  configuring: false,
  changes: [],
  shares: [],
};
const SHARED: SharedPort = {
  ...EMPTY,
  speaker: CLIENT.peer,
  shares: [
    { name: "/run/imuscope/imu0", kind: "pty", read_only: true, clients: [] },
    {
      name: "tcp://127.0.0.1:4001",
      kind: "tcp",
      read_only: false,
      clients: [
        CLIENT,
        { ...CLIENT, number: 4, name: "127.0.0.1:50999", waits: true, dropped_bytes: 300, dropped_frames: 2 },
      ],
    },
  ],
};

function open(answers: Record<string, unknown>): readonly Asked[] {
  const asked = answering(answers);
  render(<SharePort app={{} as App} device={{ id: "1", name: "MTi-630" } as DeviceInfo} onClose={() => undefined} />);
  return asked;
}
test("programs are shown with what they get, lose and may do", async () => {
  open({ [`GET ${ROUTE}`]: SHARED });
  const share = await screen.findByRole("region", { name: "tcp://127.0.0.1:4001" });
  expect(share.textContent).toContain("127.0.0.1:50312");
  expect(share.textContent).toContain("1.2 MB");
  expect(share.textContent).toContain("waits for its turn");
  expect(share.textContent).toContain("2 frames");
  expect(screen.getByRole("status").textContent).toContain("Commands from 127.0.0.1:50312");
  expect(screen.getByRole("region", { name: "/run/imuscope/imu0" }).textContent).toContain("No program connected");
});

test("a program that configures the device is named, and what it changed is shown", async () => {
  const name = "xsens_mti_node (process 4711)";
  const changes = [
    {
      client: name,
      time: 1_760_000_000,
      rows: [{ title: "Acceleration, rate", unit: "Hz", before: "400 Hz", after: "100 Hz" }],
      unread: ["Filter profile"],
      snapshot: "20261123T101500Z-set-by-xsens",
    },
  ];
  open({ [`GET ${ROUTE}`]: { ...SHARED, holder: 812, speaker: name, configuring: true, changes } });
  const status = await screen.findByRole("status");
  expect(status.textContent).toContain(`${name} is configuring the device`);
  const shown = screen.getByRole("region", { name: "Settings changed by programs" });
  expect(shown.textContent).toContain(`${name}, 08:53:20 UTC`);
  expect(shown.textContent).toContain("Acceleration, rate400 Hz → 100 Hz");
  expect(shown.textContent).toContain("Not read since: Filter profile");
  expect(screen.getByText(/Held by process 812/)).toBeTruthy();
});

test("a person takes over from a program that has not finished, after a question that names it", async () => {
  const name = "xda_host (process 4711)";
  const busy = { ...SHARED, speaker: name, configuring: true };
  const asked = open({ [`GET ${ROUTE}`]: busy, [`POST ${ROUTE}/take-over`]: { ...SHARED, speaker: "" } });
  fireEvent.click(await screen.findByRole("button", { name: "Take over…" }));
  expect(screen.getByText(`${name} has not finished. What it sends next may be refused by the device.`)).toBeTruthy();
  expect(asked.some(({ method }) => method === "POST")).toBe(false);
  fireEvent.click(screen.getByRole("button", { name: `Take over from ${name}` }));
  await waitFor(() =>
    expect(asked.filter(({ method }) => method === "POST")).toMatchObject([{ body: { confirmed: true } }]),
  );
  await waitFor(() => expect(screen.getByRole("status").textContent).not.toContain(name));
});

test("a program that floods or comes too late is told apart", async () => {
  const client = { ...CLIENT, limited: true, refused: 2_000 };
  const share = { name: "tcp://127.0.0.1:4001", kind: "tcp" as const, read_only: false, clients: [client] };
  open({ [`GET ${ROUTE}`]: { ...EMPTY, shares: [share] } });
  const shown = await screen.findByRole("region", { name: share.name });
  expect(shown.textContent).toContain("is held back");
  expect(shown.textContent).toContain("Refused2.0 kB");
});

test("a port is shared under an address that is proposed, and may be read only", async () => {
  const asked = open({ [`GET ${ROUTE}`]: EMPTY, [`POST ${ROUTE}`]: SHARED });
  await screen.findByText("The port is not shared.");
  const address = await screen.findByLabelText<HTMLInputElement>("Address");
  expect(address.value).toBe("/run/imuscope/imu0");
  fireEvent.click(screen.getByRole("button", { name: "TCP" }));
  await waitFor(() => expect(address.value).toBe("tcp://127.0.0.1:4001"));
  fireEvent.click(screen.getByRole("checkbox", { name: "Programs may only read" }));
  fireEvent.click(screen.getByRole("button", { name: "Share" }));
  await screen.findByRole("region", { name: "tcp://127.0.0.1:4001" });
  expect(asked.find(({ method }) => method === "POST")?.body).toEqual({ address: "tcp://127.0.0.1:4001?mode=read" });
  await waitFor(() => expect(address.value).toBe("tcp://127.0.0.1:4002"));
});

test("a share is ended and a program disconnected", async () => {
  const asked = open({
    [`GET ${ROUTE}`]: SHARED,
    [`DELETE ${ROUTE}/clients/3`]: SHARED,
    [`DELETE ${ROUTE}?name=%2Frun%2Fimuscope%2Fimu0`]: EMPTY,
  });
  fireEvent.click(await screen.findByRole("button", { name: "Disconnect 127.0.0.1:50312" }));
  await waitFor(() => expect(asked.some(({ path }) => path === `${ROUTE}/clients/3`)).toBe(true));
  fireEvent.click(screen.getByRole("button", { name: "End the share /run/imuscope/imu0" }));
  await screen.findByText("The port is not shared.");
});

test("a share that cannot be offered says why", async () => {
  open({ [`GET ${ROUTE}`]: EMPTY });
  await screen.findByText("The port is not shared.");
  fireEvent.click(screen.getByRole("button", { name: "Share" }));
  expect((await screen.findByRole("alert")).textContent).toContain("Nothing was recorded");
});

test("a device without a port says so, and offers no form", async () => {
  open({ [`GET ${ROUTE}`]: { ...EMPTY, why_not: "sim:xbus has no port that can be shared." } });
  await screen.findByText("sim:xbus has no port that can be shared.");
  expect(screen.queryByLabelText("Address")).toBeNull();
});

test("addresses in use are not proposed", () => {
  const names = new Set(["tcp://127.0.0.1:4001", "/run/imuscope/imu0"]);
  expect(proposal("tcp", "", names)).toBe("tcp://127.0.0.1:4002");
  expect(proposal("pty", "/run/imuscope", names)).toBe("/run/imuscope/imu1");
  expect(proposal("pty", "", names)).toBe("");
});
