/**
 * Text of devices, files and other people, as it comes from the server. Characters that turn the direction of writing (U+202E and its
 * kin) would reach beyond the text that holds them, over what the page writes after it: here they are closed at its end, in every answer
 * and message. Elements are isolated from each other by ui/base.css.
 */
const [PDF, PDI] = ["\u202c", "\u2069"]; // pop directional formatting, pop directional isolate
const CONTROLS = /[\u202a-\u202e\u2066-\u2069]/;
const ESCAPED = /\\u20(?:2[a-e]|6[6-9])/i;

/** The value of a text in JSON, with every text in it contained. SyntaxError for any other text. */
export function parseForeign(json: string): unknown {
  if (!CONTROLS.test(json) && !ESCAPED.test(json)) return JSON.parse(json);
  return JSON.parse(json, (_, value: unknown) => (typeof value === "string" ? contained(value) : value));
}

/** A text whose embeddings, overrides and isolates end with it. */
export function contained(text: string): string {
  const open: string[] = [];
  for (const one of CONTROLS.test(text) ? text : "") {
    if (one === PDI) open.length = open.includes(PDI) ? open.lastIndexOf(PDI) : open.length;
    else if (one === PDF) open.length -= open.at(-1) === PDF ? 1 : 0;
    else if (CONTROLS.test(one)) open.push(one < "\u2066" ? PDF : PDI);
  }
  return text + open.reverse().join("");
}
