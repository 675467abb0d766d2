// Questions to the server.

const KEPT = "zpm2 token";

/** An error that the server, or the browser, has a sentence for. */
export class Refused extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

export class Server {
  constructor(token) {
    this.token = token;
  }

  async get(path) {
    return (await this.ask(path, {})).json();
  }

  async post(path, value) {
    return (await this.ask(path, { method: "POST", body: JSON.stringify(value) })).json();
  }

  async blob(path, value = null) {
    return (await this.ask(path, value === null ? {} : { method: "POST", body: JSON.stringify(value) })).blob();
  }

  async send(path, file) {
    return (await this.ask(path, { method: "POST", body: file })).json();
  }

  async ask(path, options) {
    let answer;
    try {
      answer = await fetch(path, { ...options, headers: { "X-Zpm2-Token": this.token } });
    } catch {
      throw new Refused("zpm2 app does not answer: it was ended, or the connection is lost", 0);
    }
    if (answer.ok) return answer;
    const said = await answer.json().catch(() => ({}));
    throw new Refused(said.error ?? `the server answers ${answer.status}`, answer.status);
  }
}

/** The token of the address, which is taken out of it; after a reload, the one before. */
export function tokenOf() {
  const found = new URLSearchParams(location.hash.slice(1)).get("token");
  if (found) {
    sessionStorage.setItem(KEPT, found);
    history.replaceState(null, "", location.pathname);
  }
  return found ?? sessionStorage.getItem(KEPT) ?? "";
}
