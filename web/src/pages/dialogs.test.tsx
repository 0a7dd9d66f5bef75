// @vitest-environment happy-dom
/** Dialogs of Live: a device is added, and a key is given. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import { openPage } from "../testing/live-page";
import { route } from "../page/route";
import { type Answers, recorded, type Family, type Scene } from "../testing/recorded";
import { dialogNamed, noDialog } from "../testing/queries";

const open = (name: Family | Scene, answers: Answers = {}) => openPage(recorded(name), { answers });

test("a device is added by its address, and an error stays visible with its hint", async () => {
  const { asked } = await open("xbus");
  fireEvent.click(screen.getByRole("button", { name: "Add a device" }));
  const form = await dialogNamed(/Add/);
  fireEvent.input(within(form).getByLabelText("Address"), { target: { value: "/dev/none" } });
  fireEvent.submit(form.querySelector("form") as HTMLFormElement);
  const alert = await within(form).findByRole("alert");
  expect(alert.textContent).toContain("Nothing was recorded of"); // the server's message
  expect(asked.find(({ method }) => method === "POST")).toMatchObject({
    path: "/api/devices",
    body: { source: "/dev/none" },
  });
  fireEvent.click(within(form).getByRole("button", { name: "Cancel" }));
  await noDialog();
});

test("a key is requested for unverified data, and never shown", async () => {
  const key = "00112233445566778899aabbccddeeff";
  const { asked, store } = await open("unverified", { "POST /api/devices/1/read-as": {} });
  const [device] = store.devices.value;
  await waitFor(() => expect(document.querySelector("[data-key=wanted]")).not.toBeNull());
  fireEvent.click(screen.getByRole("button", { name: "Enter key…" }));
  const field = await screen.findByLabelText<HTMLInputElement>(/^Key for Secure frames/);
  expect(field.type).toBe("password");
  const before = asked.length;
  fireEvent.input(field, { target: { value: "not hex" } });
  fireEvent.submit(field.form as HTMLFormElement);
  expect((await screen.findByRole("alert")).textContent).toMatch(/hex/);
  expect(asked.length).toBe(before); // nothing was sent
  fireEvent.input(field, { target: { value: key } });
  fireEvent.submit(field.form as HTMLFormElement);
  await waitFor(() => expect(asked.length).toBeGreaterThan(before));
  expect(asked.at(-1)).toMatchObject({ body: { key } });
  expect(asked.at(-1)?.path).toContain(`/${device?.id}`);
  expect(document.body.innerHTML).not.toContain(key);
});

test("a dialog does not stay over the next page", async () => {
  const { app } = await open("xbus");
  app.overlay.value = "help";
  await screen.findByRole("dialog");
  location.hash = "#/?device=1"; // the same page
  await waitFor(() => expect(route.value.query).toBe("device=1"));
  expect(screen.queryByRole("dialog")).not.toBeNull();
  location.hash = "#/recordings";
  await noDialog();
  expect(app.overlay.value).toBeUndefined(); // or that page would show it
});
