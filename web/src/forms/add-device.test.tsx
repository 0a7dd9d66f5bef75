// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, it, vi } from "vitest";
import { protocol } from "../testing/capabilities";
import { capabilities } from "../wire/capabilities";
import { AddDevice, type Begin } from "./add-device";

const ANY = { pattern: "", malformed: "", example: "" };

function open(begin?: Begin): unknown[] {
  capabilities.value = {
    exports: [],
    absent: [],
    links: [
      {
        name: "post",
        title: "Post",
        shareable: false,
        counts_messages: false,
        examples: [{ source: "post://pigeon", words: "bytes by pigeon" }],
      },
    ],
    protocols: [
      protocol({ name: "plain", title: "Plain talk" }),
      protocol({
        name: "secret",
        title: "Secret talk",
        options: [
          { name: "key", title: "Key of the talk", kind: "secret", choices: [], default: "", early: true, ...ANY },
          {
            name: "time_unit",
            title: "Ticks",
            kind: "choice",
            choices: [
              { value: "", words: "By itself" },
              { value: "ms", words: "Milliseconds" },
            ],
            default: "",
            early: false,
            ...ANY,
          },
          { name: "loud", title: "Loud", kind: "flag", choices: [], default: "", early: false, ...ANY },
          { name: "motto", title: "Motto", kind: "text", choices: [], default: "", early: false, ...ANY },
        ],
      }),
    ],
  };
  const bodies: unknown[] = [];
  vi.stubGlobal("fetch", (_: string, { body }: RequestInit) => {
    bodies.push(JSON.parse(String(body)));
    return Promise.resolve(Response.json({ id: "7" }));
  });
  render(<AddDevice begin={begin} address={signal("")} onClose={() => undefined} onAdded={() => undefined} />);
  return bodies;
}

it("offers the server's protocols, inputs and examples, and sends the entered values", async () => {
  const bodies = open();
  expect(screen.queryByLabelText("Ticks")).toBeNull();
  expect(screen.queryByLabelText("Key of the talk")).not.toBeNull(); // before the protocol is known, too
  fireEvent.change(screen.getByLabelText("Protocol"), { target: { value: "plain" } });
  expect(screen.queryByLabelText("Key of the talk")).toBeNull();
  fireEvent.change(screen.getByLabelText("Protocol"), { target: { value: "secret" } });
  fireEvent.change(screen.getByLabelText("Ticks"), { target: { value: "ms" } });
  fireEvent.input(screen.getByLabelText("Key of the talk"), { target: { value: " 00ff " } });
  fireEvent.click(screen.getByText("post://pigeon"));
  fireEvent.click(screen.getByText("Add"));
  await waitFor(() => expect(bodies).toHaveLength(1));
  expect(bodies[0]).toEqual({ source: "post://pigeon", protocol: "secret", key: "00ff", time_unit: "ms" });
});

it("changes the decode options of a device after an edit", async () => {
  const bodies = open({ id: "1", source: "post://pigeon", protocol: "secret", options: { time_unit: "ms" } });
  expect(screen.getByText<HTMLButtonElement>("Use this key").disabled).toBe(true);
  fireEvent.change(screen.getByLabelText("Ticks"), { target: { value: "" } });
  fireEvent.click(screen.getByText("Apply"));
  await waitFor(() => expect(bodies).toHaveLength(1));
  expect(bodies[0]).toEqual({ protocol: "secret", time_unit: "" });
});

it("sends flags and texts of options", async () => {
  const bodies = open({ id: "1", source: "post://pigeon", protocol: "secret", options: { loud: "1", motto: "veni" } });
  expect(screen.getByLabelText<HTMLSelectElement>("Loud").value).toBe("1");
  expect(screen.getByLabelText<HTMLInputElement>("Motto").value).toBe("veni");
  fireEvent.change(screen.getByLabelText("Loud"), { target: { value: "" } });
  fireEvent.input(screen.getByLabelText("Motto"), { target: { value: "vidi " } });
  fireEvent.click(screen.getByText("Apply"));
  await waitFor(() => expect(bodies).toHaveLength(1));
  expect(bodies[0]).toEqual({ protocol: "secret", loud: false, motto: "vidi" });
});
