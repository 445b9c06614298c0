// Metrics in the text format of Prometheus.

const LINE = /^([a-zA-Z_:][\w:]*)(?:\{(.*)\})? (\S+)$/;

/**
 * The samples of a text by their names.
 * @param {string} text
 * @returns {Map<string, {labels: string, value: number}[]>}
 */
export function samplesOf(text) {
  const samples = new Map();
  for (const line of text.split("\n")) {
    const found = LINE.exec(line);
    if (!found) continue;
    const [, name, labels = "", value] = found;
    if (!samples.has(name)) samples.set(name, []);
    samples.get(name).push({ labels, value: Number(value) });
  }
  return samples;
}

/**
 * The sum of all samples of a name; 0 if there is none.
 * @param {ReturnType<typeof samplesOf>} samples @param {string} name
 */
export const total = (samples, name) => (samples.get(name) ?? []).reduce((sum, { value }) => sum + value, 0);
