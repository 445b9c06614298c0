// Texts that strangers could write to harm readers. Each has a mark, so that a test finds it on a page.

const MARK = "Mallory";

/** Texts that must never run, load, or turn the text around them. */
const ATTACKS = [
  `<script>alert("${MARK} 1")</script>`,
  `<img src=x onerror="alert('${MARK} 2')">`,
  `"><svg onload=alert("${MARK} 3")>`,
  `' autofocus onfocus=alert("${MARK} 4") x='`,
  `<a href="javascript:alert('${MARK} 5')">${MARK} 5</a>`,
  `</title></textarea></noscript><iframe src="https://elsewhere.example/${MARK}-6"></iframe>`,
  `<style>@import "https://elsewhere.example/${MARK}-7";</style>`,
  `{title}\${alert("${MARK} 8")}{{constructor.constructor('alert(9)')()}}`,
  `]]><!-- ${MARK} 10 --&gt; &lt;b&gt;&#x3c;script&#x3e;`,
];

/** Characters that turn text around, hide it, or draw over neighbours. */
const TURNED = "evil\u202egpj.exe\u2066\u2067\u2069 \u200b\u200dhidden\u00ad A\u0301\u0301\u0301\u0301\u0301\u0301\u0301 مرحبا שלום";
const PICTURES = "👩‍👩‍👧‍👦🏳️‍🌈👍🏽🇩🇪";

/** @param {string} text @param {number} chars */
function cut(text, chars) {
  const points = [...text];
  return points.length > chars ? points.slice(0, chars).join("") : text;
}

/** All hostile texts, and 10,000 characters without a space. */
const EVERYTHING = [...ATTACKS, TURNED, PICTURES, "W".repeat(10_000), "\u0007\u001b[31m"].join("\n");

/**
 * Texts for everything that strangers write, as support/site.mjs asks for them.
 * @type {import("./site.mjs").Texts}
 */
export const HOSTILE = {
  // Names may have no invisible characters.
  name: (what, chars = 100) => cut(`${MARK} ${what} ${ATTACKS[1]}${ATTACKS[0]}`, chars),
  message: (index) => cut(index % 4 === 3 ? TURNED + PICTURES : ATTACKS[index % ATTACKS.length], 120),
  response: EVERYTHING,
  reasoning: EVERYTHING,
  // The text's braces would be Jinja's.
  template: EVERYTHING.replaceAll(/[{}]/g, ""),
  description: cut(EVERYTHING, 10_000),
  // Control characters are refused here.
  terms: cut(EVERYTHING.replaceAll(/[\u0007\u001b]/g, ""), 15_000),
  // Invisible characters are refused here, too.
  reason: cut(`${ATTACKS.slice(0, 5).join(" ")} مرحبا שלום 🦆`, 500),
  meta: { [ATTACKS[1]]: ATTACKS[0], url: `javascript:alert("${MARK} 11")`, nested: { deep: [TURNED, "W".repeat(5_000)] } },
};

export { MARK };
