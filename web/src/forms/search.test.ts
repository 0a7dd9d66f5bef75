import { expect, it } from "vitest";
import { command, field, forms, OUTPUTS, setting, tableRow } from "../testing/fixtures";
import { indexOf, search } from "./search";

const index = indexOf(
  forms({
    settings: [
      setting({
        name: "PortConfig",
        title: "Ports",
        group: "Port and baud rate",
        fields: [field({ name: "words", choices: { "2": "115 200 Bd" } })],
      }),
      setting({
        name: "DID_FLASH_CONFIG",
        title: "Flash configuration",
        group: "Configuration",
        fields: [field({ name: "ser0BaudRate", title: "ser0BaudRate" })],
      }),
      setting({ name: "FilterProfile", title: "Filter profile", group: "Filter" }),
    ],
    commands: [command({ name: "SetBaudrate", title: "Set the baud rate", group: "Port and baud rate" })],
  }),
);
const names = (query: string) => search(index, query).map(({ name }) => name);

it("finds by name, title, field and meaning", () => {
  expect(names("filter")).toEqual(["FilterProfile"]);
  expect(names("baud")).toEqual(expect.arrayContaining(["PortConfig", "DID_FLASH_CONFIG", "SetBaudrate"]));
  expect(names("115200")).toEqual(["PortConfig"]);
  expect(search(index, "ser0")[0]).toMatchObject({ name: "DID_FLASH_CONFIG", field: "ser0BaudRate" });
});

it("lists settings before commands, deprecated ones last", () => {
  const more = indexOf(
    forms({
      settings: [
        setting({ name: "PortConfig", title: "Ports", group: "Port and baud rate" }),
        setting({ name: "Other", title: "Other", doc: "Needs a higher baud rate." }),
      ],
      commands: [
        command({ name: "ReqBaudrate", title: "Baud rate", doc: "Requests it; deprecated." }),
        command({ name: "Reset", title: "Reset at the present baud rate" }),
      ],
    }),
  );
  expect(search(more, "baud").map(({ name }) => name)).toEqual(["PortConfig", "Reset", "Other", "ReqBaudrate"]);
});

it("requires every word", () => {
  expect(names("set baud")).toEqual(["SetBaudrate"]);
  expect(names("profile baud")).toEqual([]);
  expect(names("  ")).toEqual([]);
});

it("splits names", () => {
  expect(names("port config")).toContain("PortConfig");
});

it("finds quantities by identifier and synonym", () => {
  const table = { ...OUTPUTS, rows: [tableRow(0x2010, "Quaternion")] };
  const more = indexOf(
    forms({
      settings: [
        setting({ name: "OutputConfiguration", title: "Output configuration", table }),
        setting({
          name: "DID_FLASH_CONFIG",
          title: "Flash configuration",
          fields: [field({ name: "gps1AntOffset", title: "GNSS 1 antenna offset", basic: false })],
        }),
      ],
    }),
  );
  expect(search(more, "0x2010")[0]).toMatchObject({ name: "OutputConfiguration", field: "Quaternion", at: "0x2010" });
  expect(search(more, "lever arm")[0]).toMatchObject({ name: "DID_FLASH_CONFIG", at: "gps1AntOffset" });
});

it("gives the path of a field in the form, also of a nested one", () => {
  const nested = field({
    name: "wheelConfig",
    title: "Wheel",
    editor: "record",
    fields: [field({ name: "radius", title: "Radius" })],
  });
  const more = indexOf(forms({ settings: [setting({ name: "S", fields: [nested] })] }));
  expect(search(more, "radius")[0]).toMatchObject({ field: "Radius", at: "wheelConfig" });
});
