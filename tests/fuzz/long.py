"""Many mutants over all readers, with their counts as JSON at the end.

python tests/fuzz/long.py COUNT [FIRST [READER]]
"""

import json
import sys

from harness import run, summary

if __name__ == "__main__":
    words = sys.argv[1:]
    first, only = int(words[1]) if len(words) > 1 else 0, words[2] if len(words) > 2 else ""
    found = summary(run(first, int(words[0]), only), lambda line: print(line, file=sys.stderr, flush=True))
    print(json.dumps(found, indent=1))
    sys.exit("wrong" in found)
