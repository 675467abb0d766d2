// Files that the page offers: the result, a table, and verdicts.

const COLUMNS = ["kind", "id", "left", "right", "left_label", "right_label", "left_area", "right_area", "confidence"];
const MORE = ["cost", "dsf", "stage", "overlap", "visible", "why", "verdict"];
export const VERDICTS = "zpm2-verdicts/1";

/** A table of items, with the verdict of each. */
export function csv(items, verdicts) {
  const rows = items.map((item) => {
    const [left, right] = item.polygons;
    const ids = [left?.id, right?.id, left?.label, right?.label, left?.area, right?.area];
    const { confidence, cost, dsf, stage, overlap, visible, why } = item;
    return [item.kind, item.id, ...ids, confidence, cost, dsf, stage, overlap, visible, why, verdicts[item.key]];
  });
  return csvText([[...COLUMNS, ...MORE], ...rows]);
}

/** Rows of values as comma-separated values (RFC 4180). */
export function csvText(rows) {
  return rows.map((row) => `${row.map(field).join(",")}\r\n`).join("");
}

function field(value) {
  const text = String(value ?? "");
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** What a person said of the matches: the content of verdicts.json. */
export function verdictsDocument(data, items, verdicts) {
  const photographs = Object.fromEntries(data.sides.map(({ name, path, width, height }) => [name, { path, width, height }]));
  const said = items
    .filter((item) => item.kind === "match" && verdicts[item.key])
    .map((item) => ({ match: item.id, left: item.polygons[0].id, right: item.polygons[1].id, verdict: verdicts[item.key] }));
  return { schema: VERDICTS, ...photographs, verdicts: said };
}

/** The verdicts of a file, by the key of the item; those on pairs that the page does not have are left out. Throws an
 * `Error` for another file. */
export function readVerdicts(text, items) {
  const document = JSON.parse(text);
  if (document?.schema !== VERDICTS || !Array.isArray(document.verdicts)) throw new Error(`this is no ${VERDICTS} file`);
  const known = new Map(items.filter((i) => i.kind === "match").map((i) => [`${i.left}-${i.right}`, i.key]));
  const found = {};
  for (const { left, right, verdict } of document.verdicts) {
    const key = known.get(`${left}-${right}`);
    if (key && (verdict === "right" || verdict === "wrong")) found[key] = verdict;
  }
  return found;
}

/** matches.json from the address that holds it as a gzip file without its timings, and from these. */
export async function unpacked(url, timings) {
  const packed = Uint8Array.from(atob(url.slice(url.indexOf(",") + 1)), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const text = await new Response(stream).text();
  return text.replace('"timings": {}', () => `"timings": ${timings}`);
}

/** Offers a text to the person as a file. */
export function offer(name, kind, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
