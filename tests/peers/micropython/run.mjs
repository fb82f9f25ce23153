// node run.mjs DIR: the firmware's core under MicroPython, over DIR/runs.json
import fs from "node:fs";
import path from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const here = path.dirname(fileURLToPath(import.meta.url));
const dir = path.resolve(process.argv[2]);
const module = path.join(dir, "node_modules/@micropython/micropython-webassembly-pyscript/micropython.mjs");
const { loadMicroPython } = await import(pathToFileURL(module));
const firmware = fs.readFileSync(path.join(here, "../../../firmware/laserbox/main.py"), "utf8");
const python = await loadMicroPython({ heapsize: 64 * 1024 * 1024 });
python.globals.set("RUNS", fs.readFileSync(path.join(dir, "runs.json"), "utf8"));
python.runPython(firmware.replace(/^if __name__[\s\S]*$/m, "") + "\n" + fs.readFileSync(path.join(here, "check.py"), "utf8"));
