// The order of the rows of a table of pairs.

/** The rows whose name holds a text, by a column ("" for the order of the data); those without a value come last. */
export function ordered(rows, { sort, down, text }) {
  const wanted = text.trim().toLowerCase();
  const kept = rows.filter((row) => row.name.toLowerCase().includes(wanted));
  if (!sort) return kept;
  const value = (row) => (sort === "name" ? row.name : row.values[sort]) ?? null;
  return [...kept].sort((a, b) => {
    const [u, v] = [value(a), value(b)];
    if (u === v) return 0;
    if (u === null || v === null) return u === null ? 1 : -1;
    return (u < v ? -1 : 1) * (down ? -1 : 1);
  });
}
