/** Initial definition of a vendor's own payload: the template of its protocol family, filled in. Pure. */
import type { ProtocolCapability } from "../../wire/capability-types";
import type { UnknownPayload } from "../../wire/types";

type Template = Pick<ProtocolCapability, "payload_template" | "payload_numbers">;

/** The text for the user to complete: the whole payload as numbers of one type. */
export function initialDefinition(family: Template, { id, size }: Pick<UnknownPayload, "id" | "size">): string {
  const number = family.payload_numbers.find((one) => size % one.size === 0);
  const count = number ? size / number.size : size;
  const values: Readonly<Record<string, string>> = {
    size: String(size),
    id: id.toString(16).toUpperCase().padStart(2, "0"),
    type: number?.name ?? "",
    count: String(count),
  };
  return family.payload_template
    .split("\n")
    .filter((line) => count !== 1 || !line.includes("{count}"))
    .join("\n")
    .replace(/\{(\w+)\}/g, (whole, name: string) => values[name] ?? whole);
}
