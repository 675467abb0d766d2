// States that can be undone and redone. A state is never changed in place.

const MOST = 200; // steps that can be undone

export class History {
  constructor(first) {
    [this.past, this.now, this.future] = [[], first, []];
  }

  /** A step to another state. */
  push(state) {
    this.past.push(this.now);
    if (this.past.length > MOST) this.past.shift();
    [this.now, this.future] = [state, []];
  }

  /** Changes all states, those that can be undone and redone too: for what a server says of a step long after it. */
  amend(change) {
    [this.past, this.future] = [this.past.map(change), this.future.map(change)];
    this.now = change(this.now);
  }

  undo() {
    if (!this.past.length) return false;
    this.future.push(this.now);
    this.now = this.past.pop();
    return true;
  }

  redo() {
    if (!this.future.length) return false;
    this.past.push(this.now);
    this.now = this.future.pop();
    return true;
  }
}
