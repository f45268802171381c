/* Compare outputs of timers 1 and 2.
 *
 * simavr 1.6 lets a compare value act the moment it is written, and takes the value TOP for a match. The
 * hardware buffers compare values until the counter is at BOTTOM, and is constantly high at TOP (ATmega328P
 * data sheet, 16.9.3). The ring rests on both, so the bench has its own model of what the firmware uses:
 * timer 1 in mode 14 (fast PWM, TOP = ICR1), timer 2 in normal mode, both clocked by the CPU.
 */
#include "timers.h"

#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Registers, by their address in memory. */
enum {
    PORTB = 0x25, DDRB = 0x24, PORTC = 0x28, DDRC = 0x27, PORTD = 0x2B, DDRD = 0x2A,
    TCCR1A = 0x80, TCCR1B, TCCR1C, TCNT1L = 0x84, TCNT1H, ICR1L, ICR1H, OCR1AL, OCR1AH, OCR1BL, OCR1BH,
    TCCR2A = 0xB0, TCCR2B, TCNT2, OCR2A, OCR2B,
};
enum { COM_NONE, COM_TOGGLE, COM_CLEAR, COM_SET };
enum { MODE_14 = 14, NORMAL = 0, STOPPED = 0, FULL_SPEED = 1 };
enum { DIODE_MV = 500, LIT_MV = 1500 }; /* of a pin's clamp to its supply; below the latter no LED shines */

const char *const signal_name[N_SIGNAL] = {
    "data_even", "data_odd", "clock", "latch", "oe_even", "oe_odd", "round", "slot", "light",
};

/* Where each signal comes out; `resting` is what a resistor makes of it while the pin is no output. */
static const struct { int port, direction, bit, resting; } pins[N_SIGNAL] = {
    {PORTC, DDRC, 0, 0}, {PORTC, DDRC, 1, 0}, {PORTC, DDRC, 2, 0}, {PORTC, DDRC, 3, 0}, {PORTB, DDRB, 1, 1},
    {PORTB, DDRB, 2, 1}, {PORTB, DDRB, 3, 0}, {PORTD, DDRD, 3, 0}, {PORTD, DDRD, 4, 0},
};

static void (*tell)(avr_cycle_count_t, enum signal, int);
static int level[N_SIGNAL];
static int chip_mv = 5000, leds_mv = 5000;
static avr_int_vector_t *overflow;
static struct {
    int running;
    avr_cycle_count_t start; /* when the counter was at BOTTOM */
    unsigned top, buffer[2], compare[2];
    int output[2];
} timer1;
static struct {
    int running;
    avr_cycle_count_t start;
    int output[2];
} timer2;

static int com1(avr_t *avr, int channel) { return avr->data[TCCR1A] >> (6 - 2 * channel) & 3; }
static int com2(avr_t *avr, int channel) { return avr->data[TCCR2A] >> (6 - 2 * channel) & 3; }

static void fail(const char *words) {
    fprintf(stderr, "bench: %s\n", words);
    exit(1);
}

/* ---- pins ------------------------------------------------------------------------------------------- */

/* What a shift register reads: it wants 0.7 of its own supply for a high level (TLC5916 data sheet). */
static int reads_high(int mv) { return leds_mv < LIT_MV || 10 * mv >= 7 * leds_mv; }

/* A pull-up hangs on the shift registers' supply; the clamp of a pin holds it down when the chip has none. */
static int read_pin(avr_t *avr, enum signal s) {
    int clamp = chip_mv + DIODE_MV;
    if (!(avr->data[pins[s].direction] >> pins[s].bit & 1))
        return pins[s].resting && reads_high(leds_mv < clamp ? leds_mv : clamp);
    int high = avr->data[pins[s].port] >> pins[s].bit & 1;
    if ((s == OE_EVEN || s == OE_ODD) && com1(avr, s - OE_EVEN)) high = timer1.output[s - OE_EVEN];
    if ((s == ROUND || s == SLOT) && com2(avr, s - ROUND)) high = timer2.output[s - ROUND];
    return high && reads_high(chip_mv);
}

int timers_level(enum signal signal) { return level[signal]; }

static void update(avr_t *avr, avr_cycle_count_t when, enum signal first, enum signal last) {
    for (enum signal s = first; s <= last; s++) {
        int value = read_pin(avr, s);
        if (value == level[s]) continue;
        level[s] = value;
        tell(when, s, value);
    }
}

void timers_supply(avr_t *avr, int chip, int leds) {
    chip_mv = chip, leds_mv = leds;
    update(avr, avr->cycle, 0, N_SIGNAL - 1);
}

static void on_port(struct avr_irq_t *irq, uint32_t value, void *avr) {
    (void)irq, (void)value;
    update(avr, ((avr_t *)avr)->cycle, 0, N_SIGNAL - 1);
}

/* ---- timer 1 ---------------------------------------------------------------------------------------- */

static avr_cycle_count_t match1(avr_t *avr, avr_cycle_count_t when, int channel) {
    int bottom_too = when == timer1.start + timer1.top + 1; /* which wins: constantly high at TOP */
    int com = com1(avr, channel);
    if (!bottom_too && (com == COM_CLEAR || com == COM_SET)) {
        timer1.output[channel] = com == COM_SET;
        update(avr, when, OE_EVEN, OE_ODD);
    }
    return 0;
}
static avr_cycle_count_t match1a(avr_t *avr, avr_cycle_count_t when, void *p) {
    (void)p;
    return match1(avr, when, 0);
}
static avr_cycle_count_t match1b(avr_t *avr, avr_cycle_count_t when, void *p) {
    (void)p;
    return match1(avr, when, 1);
}

static void begin_period(avr_t *avr, avr_cycle_count_t when) {
    static const avr_cycle_timer_t match[2] = {match1a, match1b};
    timer1.start = when;
    for (int channel = 0; channel < 2; channel++) {
        timer1.compare[channel] = timer1.buffer[channel];
        avr_cycle_timer_register(avr, when + timer1.compare[channel] + 1 - avr->cycle, match[channel], 0);
    }
}

static avr_cycle_count_t bottom1(avr_t *avr, avr_cycle_count_t when, void *p) {
    (void)p;
    for (int channel = 0; channel < 2; channel++)
        if (com1(avr, channel) >= COM_CLEAR) timer1.output[channel] = com1(avr, channel) == COM_CLEAR;
    update(avr, when, OE_EVEN, OE_ODD);
    begin_period(avr, when);
    avr_raise_interrupt(avr, overflow);
    return when + timer1.top + 1;
}

static void write1(avr_t *avr, avr_io_addr_t address, uint8_t value, void *p) {
    (void)p;
    avr->data[address] = address == TCCR1C ? 0 : value;
    if (address == TCCR1C)
        for (int channel = 0; channel < 2; channel++)
            if (value & 0x80 >> channel) timer1.output[channel] = com1(avr, channel) == COM_SET;
    for (int channel = 0; channel < 2; channel++)
        if (address == OCR1AL + 2 * channel) timer1.buffer[channel] = avr->data[address + 1] << 8 | value;
    if (address == ICR1L) {
        timer1.top = avr->data[ICR1H] << 8 | value;
        if (timer1.running) {
            avr_cycle_count_t end = timer1.start + timer1.top + 1;
            if (end <= avr->cycle) fail("the counter of timer 1 has passed its new TOP");
            avr_cycle_timer_register(avr, end - avr->cycle, bottom1, 0);
        }
    }
    if (address == TCCR1B) {
        int clock = value & 7, mode = (value >> 1 & 0xC) | (avr->data[TCCR1A] & 3);
        if (clock != STOPPED && (clock != FULL_SPEED || mode != MODE_14)) fail("timer 1 runs in another mode");
        avr_cycle_timer_cancel(avr, bottom1, 0);
        timer1.running = clock;
        if (clock) {
            if (avr->data[TCNT1L] || avr->data[TCNT1H]) fail("timer 1 does not start at 0");
            begin_period(avr, avr->cycle);
            avr_cycle_timer_register(avr, timer1.top + 1, bottom1, 0);
        }
    }
    update(avr, avr->cycle, OE_EVEN, OE_ODD);
}

/* ---- timer 2 ---------------------------------------------------------------------------------------- */

static avr_cycle_count_t match2(avr_t *avr, avr_cycle_count_t when, int channel) {
    int com = com2(avr, channel);
    if (com == COM_TOGGLE) fail("timer 2 toggles");
    if (com) timer2.output[channel] = com == COM_SET;
    update(avr, when, ROUND, SLOT);
    return 0; /* the same match again would change nothing */
}
static avr_cycle_count_t match2a(avr_t *avr, avr_cycle_count_t when, void *p) {
    (void)p;
    return match2(avr, when, 0);
}
static avr_cycle_count_t match2b(avr_t *avr, avr_cycle_count_t when, void *p) {
    (void)p;
    return match2(avr, when, 1);
}

static void write2(avr_t *avr, avr_io_addr_t address, uint8_t value, void *p) {
    static const avr_cycle_timer_t match[2] = {match2a, match2b};
    (void)p;
    avr->data[address] = address == TCCR2B ? value & 0x3F : value;
    if (address == TCCR2B) {
        if ((value & 7) > FULL_SPEED || (avr->data[TCCR2A] & 3) != NORMAL) fail("timer 2 runs in another mode");
        if (!timer2.running) timer2.start = avr->cycle - avr->data[TCNT2];
        timer2.running = value & 7;
        for (int channel = 0; channel < 2; channel++)
            if (value & 0x80 >> channel) match2(avr, avr->cycle, channel);
    }
    for (int channel = 0; channel < 2; channel++) {
        avr_cycle_timer_cancel(avr, match[channel], 0);
        if (!timer2.running || !com2(avr, channel)) continue;
        unsigned counter = (avr->cycle - timer2.start) & 0xFF;
        unsigned wait = (avr->data[OCR2A + channel] + 1 - counter) & 0xFF;
        avr_cycle_timer_register(avr, wait ? wait : 256, match[channel], 0);
    }
    update(avr, avr->cycle, ROUND, SLOT);
}

/* ---- the whole -------------------------------------------------------------------------------------- */

static void on_reset(struct avr_io_t *io) {
    memset(&timer1, 0, sizeof timer1);
    memset(&timer2, 0, sizeof timer2);
    update(io->avr, io->avr->cycle, 0, N_SIGNAL - 1);
}

void timers_attach(avr_t *avr, void (*changed)(avr_cycle_count_t, enum signal, int)) {
    static avr_io_t module = {.kind = "ring", .reset = on_reset};
    static const avr_io_addr_t first[2] = {TCCR1A, TCCR2A}, last[2] = {OCR1BH, OCR2B};
    tell = changed;
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "timer") && ((avr_timer_t *)io)->name == '1')
            overflow = &((avr_timer_t *)io)->overflow;
    for (int timer = 0; timer < 2; timer++)
        for (avr_io_addr_t address = first[timer]; address <= last[timer]; address++) {
            avr->io[AVR_DATA_TO_IO(address)].w.c = timer ? write2 : write1;
            avr->io[AVR_DATA_TO_IO(address)].w.param = 0;
        }
    for (const char *port = "BCD"; *port; port++) {
        avr_irq_t *irq = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(*port), IOPORT_IRQ_PIN_ALL);
        avr_irq_register_notify(irq, on_port, avr);
    }
    for (enum signal s = 0; s < N_SIGNAL; s++) level[s] = pins[s].resting;
    avr_register_io(avr, &module);
}
