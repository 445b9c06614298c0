// The real program as a process, over a database of its own.
import { spawn, spawnSync } from "node:child_process";
import { mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";

const ROOT = path.join(path.dirname(fileURLToPath(import.meta.url)), "../../..");
export const BINARY = process.env.SWARMBENCH_BINARY ?? path.join(ROOT, "target/debug/swarmbench");

const START_MS = 60_000;

/** An unexpected answer. */
class Unexpected extends Error {}

export class Program {
  /** @param {{keys?: boolean, args?: string[]}} [options] `keys`: with an organizer's key, in `organizer` */
  static async start({ keys = false, args = [] } = {}) {
    const program = new Program();
    program.folder = await mkdtemp(path.join(tmpdir(), "swarmbench-pages-"));
    program.database = path.join(program.folder, "games.db");
    program.args = args;
    if (keys) program.organizer = program.#firstKey();
    await program.#open("127.0.0.1:0");
    return program;
  }

  /** Stops the program and starts it again at the same address. @param {() => Promise<void>} [meanwhile] */
  async restart(meanwhile) {
    await this.#close();
    await meanwhile?.();
    await this.#open(new URL(this.url).host);
  }

  async stop() {
    await this.#close();
    await rm(this.folder, { recursive: true, force: true });
  }

  /**
   * Sends a request and reads its answer.
   * @param {string} method
   * @param {string} route
   * @param {{body?: unknown, token?: string, text?: boolean}} [options]
   */
  async call(method, route, { body, token = this.organizer, text = false } = {}) {
    const headers = new Headers();
    if (token) headers.set("Authorization", `Bearer ${token}`);
    if (body !== undefined) headers.set("Content-Type", "application/json");
    const sent = body === undefined ? undefined : JSON.stringify(body);
    const response = await fetch(this.url + route, { method, headers, body: sent });
    const answer = await response.text();
    if (!response.ok) throw new Unexpected(`${method} ${route}: ${response.status} ${answer}`);
    return text || answer === "" ? answer : JSON.parse(answer);
  }

  get = (route, options) => this.call("GET", route, options);
  post = (route, body, options) => this.call("POST", route, { body, ...options });

  #firstKey() {
    const made = spawnSync(BINARY, ["key", "create", "--name", "olga", "--role", "organizer", "--db", this.database]);
    const key = /secret_\w+/.exec(String(made.stdout));
    if (!key) throw new Unexpected(`no key: ${made.error ?? made.stderr}`);
    return key[0];
  }

  /** @param {string} address */
  async #open(address) {
    this.process = spawn(BINARY, ["serve", "--addr", address, "--db", this.database, ...this.args], {
      stdio: ["ignore", "ignore", "pipe"],
      // A log level of the caller could hide the address.
      env: { ...process.env, RUST_LOG: "info" },
    });
    this.ended = new Promise((resolve) => this.process.once("close", resolve));
    this.url = await this.#served();
  }

  #served() {
    let log = "";
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => reject(new Unexpected(`not ready: ${log}`)), START_MS);
      this.process.once("error", reject);
      this.process.once("close", (code) => reject(new Unexpected(`ended with ${code}: ${log}`)));
      const read = (/** @type {Buffer} */ part) => {
        log += part;
        const found = /documentation at (\S+)\/docs/.exec(log);
        if (!found) return;
        clearTimeout(timer);
        this.process.stderr.off("data", read).resume();
        resolve(found[1]);
      };
      this.process.stderr.on("data", read);
    });
  }

  async #close() {
    this.process.kill("SIGTERM");
    await this.ended;
  }
}
