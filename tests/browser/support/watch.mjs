// Watches a page: every fault for a visitor or an operator fails the test.

/** Runs in the page: reports of the policy become errors on the console. */
function reportPolicy() {
  addEventListener("securitypolicyviolation", (event) => {
    console.error(`policy: ${event.violatedDirective} refused ${event.blockedURI} ${event.sample}`);
  });
}

/** Errors of requests that a page cancels because the visitor leaves, or the answer is no longer needed. */
const GIVEN_UP = new Set(["net::ERR_ABORTED"]);

/** Credentials: they belong in one header, never in an address, which logs and histories keep. */
const SECRET = /(secret|seat|swarm|invite)_[a-z0-9]{16}/;

export class Watch {
  /** @type {string[]} */
  faults = [];
  /** @type {RegExp[]} */
  expected = [];
  /** @type {Set<string>} */
  origins = new Set();

  /**
   * @param {import("playwright-core").BrowserContext} context
   * @param {string} origin the only one that may be asked
   */
  static async over(context, origin) {
    const watch = new Watch();
    watch.allow(origin);
    await context.addInitScript(reportPolicy);
    await context.route(
      (url) => !watch.origins.has(url.origin) && !["data:", "blob:", "about:"].includes(url.protocol),
      (route) => {
        watch.faults.push(`request to elsewhere: ${route.request().url()}`);
        return route.abort();
      },
    );
    context.on("dialog", (dialog) => {
      watch.faults.push(`dialog: ${dialog.message()}`);
      void dialog.dismiss();
    });
    context.on("weberror", (error) => watch.note(`error: ${error.error().stack}`));
    context.on("console", (message) => {
      if (message.type() === "error") watch.note(`console: ${message.text()} (${message.location().url})`);
    });
    context.on("request", (request) => watch.address(request.url()));
    context.on("page", (page) => page.on("framenavigated", (frame) => watch.address(frame.url())));
    context.on("requestfailed", (request) => {
      const reason = request.failure()?.errorText ?? "";
      if (!GIVEN_UP.has(reason)) watch.note(`failed: ${request.url()} ${reason}`);
    });
    context.on("response", (response) => {
      if (response.status() >= 400) watch.note(`answer: ${response.status()} ${response.url()}`);
    });
    return watch;
  }

  /** @param {string} origin one more that may be asked */
  allow(origin) {
    this.origins.add(origin);
  }

  /** Allows faults that a test causes. @param {...RegExp} patterns */
  expect(...patterns) {
    this.expected.push(...patterns);
  }

  /** Acts without watching: a private server refuses the requests of pages before a key is entered. @param {() => Promise<void>} act */
  async without(act) {
    const { expected } = this;
    this.expected = [/./];
    await act();
    this.expected = expected;
  }

  /** @param {string} fault */
  note(fault) {
    if (!this.expected.some((pattern) => pattern.test(fault))) this.faults.push(fault);
  }

  /** @param {string} url */
  address(url) {
    if (SECRET.test(url)) this.faults.push(`a secret in an address: ${url}`);
  }

  /** Notes data that pages left in the browser for the next user. @param {import("playwright-core").BrowserContext} context */
  async leavings(context) {
    const { cookies, origins } = await context.storageState();
    const kept = [...cookies, ...origins.flatMap(({ localStorage }) => localStorage)];
    for (const { name } of kept) this.faults.push(`kept in the browser: ${name}`);
  }

  /** Fails if a fault was noted. */
  check() {
    if (this.faults.length > 0) throw new Error(`faults of the page:\n${[...new Set(this.faults)].slice(0, 20).join("\n")}`);
  }
}
