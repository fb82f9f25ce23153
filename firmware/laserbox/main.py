"""Reference firmware of the laser box, for MicroPython. NOT TESTED ON HARDWARE: see README.md beside this file.

`Box` is the protocol of `markerseek.wire.laserbox`; it knows no pin and no clock, and the tests of markerseek run it
byte for byte against the emulator. `main` gives it pins, a serial line and a watchdog.
"""
# ruff: noqa: INP001, UP032 - a board has files, not packages; f-strings came late to MicroPython

LEASE_MS = 100
IDENTITY = "laserbox1"
VERSION = 7
LINE_BYTES = 80
MAX_PULSES = 1024
MAX_RATE_HZ = 1000
MAX_EXPIRY_MS = 60000
MAX_SWEEP_PULSES = 10000
MIN_PERIOD_US = 2000  # each pulse of a sweep is reported before the next is fired
MAX_PERIOD_US = 10000000
MAX_COUNT = 2147483647
MAX_PULSES_PER_MINUTE = 6000  # what 100 Hz gives without a pause; change it with the laser safety officer only
LIGHT_LATE_US = 1000  # longest time from a trigger to its light, when the photodiode is read

PIN_LASER = 2
PIN_ACQUISITION = 3
PIN_PHOTODIODE = 4
PIN_INTERLOCK = 5
PIN_PROGRAM = 6  # tied to ground at power-up: no box, but a board that takes a new program
PIN_METER = None  # 26: what the light meter says; None: the board has none
METER_US = 30  # from the beginning of a trigger to the reading of the light meter
PULSE_US = 10


def crc16(data):
    """CRC-16/CCITT-FALSE."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def line_of(text):
    """Line of a text, with its CRC and its end."""
    return line_of_bytes(text.encode())


def line_of_bytes(data):
    """Line of what stands before the star."""
    return data + "*{:04X}\n".format(crc16(data)).encode()


ARGUMENTS = {"HELLO": 0, "PERMIT": 5, "SWEEP": 4, "TIME": 1, "BEAT": 1, "FIRE": 1, "DISARM": 0}


def period_of(rate_hz):
    """Time between two triggers, rounded to microseconds."""
    return (2000000 + rate_hz) // (2 * rate_hz)


def number(word):
    """Whole number of a word from 0 to MAX_COUNT, or None."""
    if not 1 <= len(word) <= 10:
        return None
    for letter in word:
        if letter not in "0123456789":
            return None
    if word[0] == "0" and word != "0":
        return None
    value = int(word)
    return value if value <= MAX_COUNT else None


class Box:
    """The protocol.

    `trigger(laser)` is called for each trigger, `photodiode()` returns the pulses seen since power-up,
    `interlock_closed()` whether it may fire, and `light()`, of a board with a light meter, the sum since power-up of
    what it read of each pulse. An interrupt sets `interlock_opened` whenever the interlock opens, so that
    it is noticed also where it closes again before the next turn of the loop.

    A permit is leave for light. A train is what goes to the acquisition: it is completed at the same rate, without
    light, when the permit is taken away, so that an acquisition that counts triggers never waits for the rest.

    Permit and train are a token, pulses, the time between two in us, triggers, and whether they are those of a sweep,
    which are stamped one by one; else they are averaged.
    """

    def __init__(self, trigger, photodiode, interlock_closed, light=None):
        self.trigger = trigger
        self.photodiode = photodiode
        self.interlock_closed = interlock_closed
        self.metered = light is not None
        self.light = light or (lambda: 0)
        self.now_us = 0
        self.buffer = b""
        self.too_long = False
        self.said = b""
        self.last_token = 0
        self.last_step = 0
        self.interlock_opened = False
        self.permit = None
        self.lease_ends_us = 0
        self.expires_us = 0
        self.train = None
        self.due_us = 0
        self.triggers = 0
        self.sent = 0
        self.seen_before = 0
        self.light_before = 0
        self.last_trigger_us = 0
        self.untold = None  # stamp of the last pulse of a sweep; counts of photodiode and light before it
        self.dark_told = True
        self.fired = []  # second and pulses, of the last minute

    def advance(self, now_us):
        """Do what is due until that moment; what is said comes back."""
        self.now_us = max(self.now_us, now_us)
        self._act()
        return self._take()

    def feed(self, data):
        """Take in bytes from the host; what is said comes back."""
        for value in data:
            if value == 10:
                line, self.buffer = (b"" if self.too_long else self.buffer), b""
                self.too_long = False
                self._obey(line)
            elif len(self.buffer) >= LINE_BYTES - 1:
                self.too_long = True
            else:
                self.buffer += bytes((value,))
        return self._take()

    def _take(self):
        said, self.said = self.said, b""
        return said

    def _act(self):
        """One turn of the loop."""
        if self._interlock_open() or (
            self.permit is not None and self.now_us >= min(self.lease_ends_us, self.expires_us)
        ):
            self.permit = None
        if self.train is None:
            return
        self._tell_light()
        if self.triggers < self.train[3]:
            if self.due_us <= self.now_us:
                self._pull()
                self._tell_light()
        elif self.now_us >= self.last_trigger_us + LIGHT_LATE_US:
            seen = self.photodiode() - self.seen_before
            light = min(self.light() - self.light_before, MAX_COUNT)
            self.said += line_of("DONE {} {} {} {}".format(self.train[0], self.sent, seen, light))
            self.train = None

    def _tell_light(self):
        """Tell the last pulse of a sweep once its light has been seen, and once the last of all."""
        if self.untold is not None and self.now_us >= self.last_trigger_us + LIGHT_LATE_US:
            stamp_us, before, light = self.untold
            self.untold = None
            seen, light = self.photodiode() - before, min(self.light() - light, MAX_COUNT)
            self.said += line_of("PULSE {} {} {} {} {}".format(self.train[0], self.sent, stamp_us, seen, light))
        if self.permit is None and self.untold is None and not self.dark_told:
            self.dark_told = True
            self.said += line_of("DARK {} {} {}".format(self.train[0], self.sent, self.photodiode() - self.seen_before))

    def _interlock_open(self):
        """Whether the interlock is open, or was since the last call."""
        if self.interlock_opened:
            self.interlock_opened = False
            return True
        return not self.interlock_closed()

    def _obey(self, line):
        reason = self._command(line)
        if reason:
            self.permit = None
            self.said += line_of("ERR " + reason)

    def _command(self, line):
        star = line.rfind(b"*")
        if star < 0 or line + b"\n" != line_of_bytes(line[:star]) or max(line[:star] + b"\0") > 127:
            return "CRC"
        words = line[:star].decode().split(" ")
        verb = words[0]
        numbers = [number(word) for word in words[1:]]
        if None in numbers or len(numbers) != ARGUMENTS.get(verb):
            return "FORM"
        if verb == "HELLO":
            return self._greet()
        if verb == "PERMIT":
            return self._take_permit(*numbers)
        if verb == "SWEEP":
            return self._take_sweep(*numbers)
        if verb == "BEAT":
            return self._renew(numbers[0])
        if verb == "FIRE":
            return self._fire(numbers[0])
        if verb == "TIME":
            self.said += line_of("OK TIME {} {}".format(numbers[0], self.now_us & MAX_COUNT))
        else:
            self.permit = None
            self.said += line_of("OK DISARM")
        return None

    def _greet(self):
        if self.train is not None:
            return "BUSY"
        self.permit = None
        self.last_step = 0
        words = IDENTITY, VERSION, LEASE_MS, self.last_token, self._seen(), int(self.metered)
        self.said += line_of("OK HELLO {} {} {} {} {} {}".format(*words))
        return None

    def _renew(self, step):
        if step <= self.last_step:
            return "STEP"
        self.last_step = step
        self.lease_ends_us = self.now_us + 1000 * LEASE_MS
        return None

    def _take_permit(self, token, pulses, rate_hz, expiry_ms, triggers):
        if not (
            token >= 1
            and 1 <= triggers <= MAX_PULSES
            and pulses <= triggers
            and 1 <= rate_hz <= MAX_RATE_HZ
            and 1 <= expiry_ms <= MAX_EXPIRY_MS
            and 1000 * triggers <= rate_hz * MAX_EXPIRY_MS
        ):
            return "FORM"
        return self._permit("PERMIT", (token, pulses, period_of(rate_hz), triggers, False), expiry_ms)

    def _take_sweep(self, token, pulses, period_us, expiry_ms):
        if not (
            token >= 1
            and 1 <= pulses <= MAX_SWEEP_PULSES
            and MIN_PERIOD_US <= period_us <= MAX_PERIOD_US
            and 1 <= expiry_ms <= MAX_EXPIRY_MS
            and pulses * period_us <= 1000 * MAX_EXPIRY_MS
        ):
            return "FORM"
        return self._permit("SWEEP", (token, pulses, period_us, pulses, True), expiry_ms)

    def _permit(self, verb, permit, expiry_ms):
        token, pulses = permit[:2]
        if self.train is not None:
            return "BUSY"
        if self._interlock_open():
            return "INTERLOCK"
        if token <= self.last_token:
            return "TOKEN"
        if self._pulses_of_last_minute() + pulses > MAX_PULSES_PER_MINUTE:
            return "BUDGET"
        self.last_token = token
        self.permit = permit
        self.lease_ends_us = self.now_us + 1000 * LEASE_MS
        self.expires_us = self.now_us + 1000 * expiry_ms
        self.said += line_of("OK {} {} {}".format(verb, token, self._seen()))
        return None

    def _seen(self):
        return self.photodiode() & MAX_COUNT

    def _pulses_of_last_minute(self):
        """Pulses sent in the last 60 s, counted in whole seconds: up to one second's too many, never too few."""
        oldest_s = self.now_us // 1000000 - 60
        self.fired = [entry for entry in self.fired if entry[0] >= oldest_s]
        return sum([entry[1] for entry in self.fired])

    def _fire(self, token):
        if self.permit is None or self.train is not None or token != self.permit[0]:
            return "TOKEN"
        self.train = self.permit
        self.triggers = self.sent = 0
        self.dark_told = not self.train[4]
        self.seen_before = self.photodiode()
        self.light_before = self.light()
        self.due_us = self.now_us
        self._act()
        return None

    def _pull(self):
        _token, pulses, period_us, triggers, swept = self.train
        laser = self.permit is not None and self.triggers < pulses
        if laser and swept:
            self.untold = (self.now_us & MAX_COUNT, self.photodiode(), self.light())
        self.trigger(laser)
        self.triggers += 1
        self.last_trigger_us = self.now_us
        if laser:
            self.sent += 1
            second = self.now_us // 1000000
            if not self.fired or self.fired[-1][0] != second:
                self.fired.append([second, 0])
            self.fired[-1][1] += 1
        if self.triggers >= triggers:
            self.permit = None
        # a pulse that comes late by half a period puts off the others: never two in a burst; in a sweep any late one
        self.due_us = max(self.due_us + period_us, self.now_us + (period_us if swept else period_us // 2))


def main():
    """Run the box on a board with MicroPython (written for an RP2040)."""
    import select
    import sys
    import time

    import micropython

    import machine

    # low before anything else; the pull-down on the board holds it while there is no program at all
    laser = machine.Pin(PIN_LASER, machine.Pin.OUT, value=0)
    acquisition = machine.Pin(PIN_ACQUISITION, machine.Pin.OUT, value=0)
    interlock = machine.Pin(PIN_INTERLOCK, machine.Pin.IN, machine.Pin.PULL_DOWN)
    if machine.Pin(PIN_PROGRAM, machine.Pin.IN, machine.Pin.PULL_UP).value() == 0:
        return  # before the watchdog, which nothing stops once it runs
    micropython.kbd_intr(-1)  # byte 3 is data, not Ctrl-C
    watchdog = machine.WDT(timeout=50)
    seen = [0]

    def count(_pin):
        seen[0] += 1

    machine.Pin(PIN_PHOTODIODE, machine.Pin.IN).irq(count, machine.Pin.IRQ_RISING, hard=True)

    meter = None if PIN_METER is None else machine.ADC(PIN_METER)
    light = [0]

    def trigger(with_laser):
        # what is left of the pulse before, and the meter's own zero
        rest = 0 if meter is None else meter.read_u16()
        laser.value(1 if with_laser else 0)
        acquisition.value(1)
        time.sleep_us(PULSE_US)
        laser.value(0)
        acquisition.value(0)
        if meter is not None and with_laser:
            time.sleep_us(METER_US - PULSE_US)
            light[0] += max(0, meter.read_u16() - rest)

    now_us, ticks = 0, time.ticks_us()
    box = Box(
        trigger,
        lambda: seen[0],
        lambda: interlock.value() == 1,
        None if meter is None else lambda: light[0],
    )

    def opened(_pin):
        box.interlock_opened = True

    interlock.irq(opened, machine.Pin.IRQ_FALLING, hard=True)
    poll = select.poll()
    poll.register(sys.stdin, select.POLLIN)
    while True:
        watchdog.feed()
        later = time.ticks_us()
        now_us += time.ticks_diff(later, ticks)
        ticks = later
        said = box.advance(now_us)
        if poll.poll(0):
            said += box.feed(sys.stdin.buffer.read(1))
        if said:
            sys.stdout.buffer.write(said)


if __name__ == "__main__" and __import__("sys").implementation.name == "micropython":
    main()
