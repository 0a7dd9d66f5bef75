// @vitest-environment happy-dom
/** A payload without a description: its bytes, and the form that defines it. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import { openPage } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";
import { dialogNamed, noDialog } from "../../testing/queries";

test("a vendor payload is defined; errors of the server are shown", async () => {
  const { store, asked } = await openPage(recorded("shared-link"));
  await waitFor(() => expect(store.unknownPayloads.value.length).toBeGreaterThan(0));
  const [payload] = store.unknownPayloads.value;
  fireEvent.click(screen.getByText("IDTP device 9", { selector: ".choose-device b" }));
  const panel = within(await screen.findByRole("region", { name: "Raw payloads" }));
  await waitFor(() => expect(document.querySelector(".payload-bytes")?.textContent).toMatch(/06 FF/)); // the high byte of −250
  fireEvent.click(panel.getByRole("button", { name: /^Define payload/ }));
  const form = await dialogNamed(/^Define payload/);
  await waitFor(() => expect(form.querySelector(".inside")?.contains(document.activeElement)).toBe(true)); // not ×
  const text = within(form).getByLabelText<HTMLTextAreaElement>("Fields, in byte order");
  await waitFor(() => expect(text.value).toContain("count = 2"));
  const meant = text.value.replace('unit = ""', 'unit = "m/s"');
  fireEvent.input(text, { target: { value: meant } });
  fireEvent.click(within(form).getByRole("button", { name: "Use this definition" }));
  fireEvent.submit(form.querySelector("form") as HTMLFormElement);
  expect((await within(form).findByRole("alert")).textContent).toContain("Nothing was recorded of");
  expect(text.getAttribute("aria-invalid")).toBe("true");
  expect(asked.filter(({ body }) => JSON.stringify(body) === JSON.stringify({ schema: meant })).length).toBeGreaterThan(
    0,
  );
  expect(payload?.name).toContain("0x80");
  fireEvent.click(within(form).getByRole("button", { name: "Cancel" }));
  await noDialog();
});
