/* Slots and crossfades.
 *
 * Timer 1 (fast PWM, TOP = ICR1) makes both carriers: the output enables are high (dark) from the start of
 * each period of 256 cycles until the compare match, low (lit) from there to its end. Compare registers
 * are double buffered, so what an interrupt writes during one period holds from the start of the next, to
 * the cycle, however late the interrupt came. A slot is n_period periods; its first is longer by `extra`
 * cycles, so slots of any length start on a period too.
 *
 * The shift registers have latches: the next slot's LEDs are shifted in while the present ones shine, and
 * latched in the first microseconds of the slot, when the chain that changes is dark.
 *
 * Timer 2 runs in step with timer 1, and its compare outputs make the trigger edges: armed in the last
 * period of a slot, they fire at its end.
 */
#include "light.h"

#include <avr/interrupt.h>
#include <util/atomic.h>

#include "currents.h"
#include "pins.h"
#include "reset.h"

#define PERIOD 256      /* cycles of a carrier period */
#define TOP (PERIOD - 1)
#define NEVER 0xFFFF    /* a compare value above every TOP: dark */
#define HALF 0x800000UL /* half a cycle, in the 8.24 numbers of a fade */
#define PULSE 6         /* periods that a trigger lasts */
#define TIMER2_LAG 2    /* cycles between the starts of timers 1 and 2 */
#define CHIPS ((N_LED / 2 + 7) / 8) /* of 8 outputs, in each chain */

#define PWM_ON (_BV(WGM11) | _BV(COM1A1) | _BV(COM1B1))
#define FORCE_HIGH (_BV(COM1A1) | _BV(COM1A0) | _BV(COM1B1) | _BV(COM1B0))
#define ROUND_SETS (_BV(COM2A1) | _BV(COM2A0))
#define SLOT_SETS (_BV(COM2B1) | _BV(COM2B0))
#define BOTH_CLEAR (_BV(COM2A1) | _BV(COM2B1))

struct settings settings;

/* Shared with carrier.S. */
enum event { EVENT_LAST = 1, EVENT_FIRST = 2, EVENT_SECOND = 4, EVENT_OTHER = 0 };
volatile uint16_t carrier_left; /* periods until there is more to do than to fade, */
enum event carrier_event;       /* and what that is */
volatile bool carrier_fades;    /* each period moves `lit` by `step` */
uint32_t carrier_lit[2], carrier_step[2];
uint16_t carrier_first[2], carrier_second[2]; /* compare values of the next slot's first two periods */
uint16_t carrier_top;                         /* of its first period */
uint8_t carrier_edges;                        /* bits of TCCR2A that set the triggers at its start */

/* What a chain does in a slot, up to the fade: compare values of its first period and of those that follow. */
struct course {
    uint32_t lit; /* 8.24: lit cycles of a period, before the fade moves on */
    uint16_t first;
    uint8_t second;
};

/* What an LED can do, reckoned before a run; only one holds in a slot. */
static struct course rise[N_LED], fall[N_LED];
static uint32_t rise_step[N_LED]; /* 8.24, per period; an LED falls as it rises */
static struct course held_on;
static const struct course dark = {HALF, NEVER, TOP};

/* The next slot; index 0 is the even chain, 1 the odd one. */
static const struct course *next_course[2];
static uint32_t next_step[2];
static enum cause next_end; /* why the run is over, and this slot dark */
static uint16_t busy, fade_from, last; /* periods of a slot: with more to do next; before the fade; the last */
static uint16_t left_seen;
static enum cause end;               /* of the present slot */
static volatile bool running, ready; /* ready: the next slot is prepared */
static volatile uint8_t ticked, alive_ms;
static volatile enum cause cause;
static uint8_t index_next; /* of the slot being prepared, in the order */
static uint8_t held[2];    /* LED that each chain's latch holds in the slot prepared before, */
static uint8_t on_led[2];  /* that which shines there, */
static uint16_t on_slots[2], most_slots; /* for how many slots in a row, and how many it may */
static uint32_t rounds_left, rounds_done;
static bool counted; /* the first round has begun */
static uint8_t timer2_phase;

static uint8_t after(uint8_t index) { return index + 1U == settings.n_slot ? 0 : index + 1; }

/* ---- shift registers ------------------------------------------------------------------------------ */

/* Shift in a pattern with one LED in each chain, or NONE; LED n is output n / 2. */
static void shift(uint8_t even, uint8_t odd) {
    even >>= 1, odd >>= 1;
    for (uint8_t output = 8 * CHIPS; output--;) {
        uint8_t data = 0;
        if (output == even) data |= DATA_EVEN;
        if (output == odd) data |= DATA_ODD;
        PORTC = data;
        PORTC = data | CLOCK;
    }
    PORTC = 0;
}

static inline void latch(void) {
    PORTC |= LATCH;
    PORTC &= ~LATCH;
}

/* ---- before a run ----------------------------------------------------------------------------------- */

static uint16_t first_compare(uint8_t lit) {
    return lit ? TOP + settings.extra - (lit + (((uint16_t)lit * settings.extra) >> 8)) : NEVER;
}

/* Give the course of lit cycles in 8.24. */
static struct course course(uint32_t lit, uint32_t first, uint32_t second) {
    return (struct course){
        lit + HALF, first_compare((first + HALF) >> 24), TOP - (uint8_t)((second + HALF) >> 24)};
}

/* Lit cycles of a period in which an LED is fully on. */
static uint8_t duty(uint8_t led) {
    return (uint16_t)settings.trim[led] * (pgm_read_byte(&most_current[led]) + 1) >> 8;
}

/* Reckon how an LED goes from dark to its duty and back. Each period has the value of its middle. */
static void reckon(uint8_t led) {
    uint32_t full = (uint32_t)duty(led) << 24, step = duty(led) * settings.fade_rate;
    uint32_t lit = 0 - step / 2, first = 0, second = 0;
    if (settings.n_fade + 1 >= settings.n_period) { /* the fade is under way in period 1 */
        lit = step / 2;
        if (settings.n_fade == settings.n_period) { /* and in period 0, which is longer */
            uint32_t early = (step >> 8) * settings.extra;
            first = (early + step) / 2;
            lit += step + early;
        }
        second = lit;
    }
    rise[led] = course(lit, first, second);
    fall[led] = course(full - lit, full - first, full - second);
    rise_step[led] = step;
}

static const struct course *hold(uint8_t led) {
    uint8_t lit = duty(led);
    held_on = (struct course){HALF + ((uint32_t)lit << 24), first_compare(lit), TOP - lit};
    return &held_on;
}

/* ---- one slot ahead --------------------------------------------------------------------------------- */

/* Say if the LED of a chain would be lit for too long in a row. */
static bool over_limit(uint8_t chain, uint8_t led) {
    if (led != on_led[chain]) {
        on_led[chain] = led;
        on_slots[chain] = 0;
    }
    return led != NONE && ++on_slots[chain] > most_slots;
}

static inline void set_course(uint8_t chain, const struct course *course) {
    next_course[chain] = course;
    carrier_first[chain] = course->first;
    carrier_second[chain] = course->second;
}

/* Prepare the next slot and shift in its LEDs. */
static void prepare(void) {
    uint8_t from = settings.order[index_next], to, wanted[2] = {NONE, NONE}, lit[2] = {NONE, NONE};
    const struct course *course[2] = {&dark, &dark};

    next_step[0] = next_step[1] = 0;
    next_end = CAUSE_NONE;
    carrier_edges = settings.sync ? SLOT_SETS : 0;
    if (index_next == 0) {
        carrier_edges |= ROUND_SETS;
        if (settings.rounds && rounds_left-- == 0) next_end = CAUSE_DONE;
    }
    index_next = after(index_next);
    to = settings.order[index_next];
    if (to != NONE) wanted[to & 1] = to;
    if (from != NONE) wanted[from & 1] = from;
    if (!next_end) {
        bool fading = settings.n_fade && to != from;
        if (fading && to != NONE) {
            course[to & 1] = &rise[to];
            next_step[to & 1] = rise_step[to];
            lit[to & 1] = to;
        }
        if (from != NONE) {
            if (fading) next_step[from & 1] = -rise_step[from];
            course[from & 1] = fading ? &fall[from] : hold(from);
            lit[from & 1] = from;
        }
        if (over_limit(0, lit[0]) | over_limit(1, lit[1])) {
            course[0] = course[1] = &dark;
            next_step[0] = next_step[1] = 0;
            carrier_edges = 0;
            next_end = CAUSE_LIMIT;
        }
    }
    set_course(0, course[0]);
    set_course(1, course[1]);
    if (lit[0] == from && held[0] != from) carrier_first[0] = NEVER; /* latched only now */
    if (lit[1] == from && held[1] != from) carrier_first[1] = NEVER;
    held[0] = wanted[0], held[1] = wanted[1];
    shift(wanted[0], wanted[1]);
    __asm__ volatile("" ::: "memory"); /* all of it is written */
    ready = true;
}

/* ---- carrier ---------------------------------------------------------------------------------------- */

/* Let the carrier run on to a period of the slot, and do something there. */
static void expect(uint16_t from, uint16_t period, enum event event) {
    busy = period;
    carrier_left = period - from;
    carrier_event = event;
}

/* A slot has begun. */
static void begin_slot(void) {
    expect(0, 1, EVENT_SECOND);
    for (uint8_t chain = 0; chain < 2; chain++) {
        carrier_lit[chain] = next_course[chain]->lit;
        carrier_step[chain] = next_step[chain];
    }
    carrier_fades = fade_from == 0;
    timer2_phase += settings.extra;
    OCR2A = OCR2B = timer2_phase;
    end = next_end;
    if (carrier_edges & _BV(COM2A0)) { /* a round, too */
        if (counted) rounds_done++;
        counted = true;
    }
    if (end) return; /* no slot comes after it */
    ready = false;
    sei();
    prepare();
}

/* The last period of a slot has begun. */
static void end_slot(void) {
    carrier_fades = false;
    if (ready)
        expect(last, last + 1, EVENT_FIRST);
    else
        light_dark(CAUSE_LATE);
}

/* A period has begun in which there is more to do than to fade, and carrier.S has done what can't wait. */
ISR(SPM_READY_vect) {
    uint16_t p = busy;
    if (p == last + 1) {
        begin_slot();
    } else if (p == last) {
        end_slot();
    } else {
        uint16_t then = last;
        if (p == fade_from) carrier_fades = true;
        if (p < fade_from) then = fade_from;
        if (p < PULSE && PULSE < then) then = PULSE;
        expect(p, then, then == last ? EVENT_LAST : EVENT_OTHER);
        if (p == PULSE) {
            TCCR2A = BOTH_CLEAR;
            if (end) light_dark(end);
        }
    }
}

/* ---- starting and stopping -------------------------------------------------------------------------- */

void light_init(void) {
    PORTB = OE_EVEN | OE_ODD;
    PORTC = 0;
    PORTD &= ~(SLOT | LIGHT);
    DDRC = DATA_EVEN | DATA_ODD | CLOCK | LATCH;
    DDRB = OE_EVEN | OE_ODD | ROUND;
    DDRD |= SLOT | LIGHT;
    shift(NONE, NONE);
    latch();
    TCCR0A = _BV(WGM01); /* a tick per millisecond */
    OCR0A = F_CPU / 64 / 1000 - 1;
    TIMSK0 = _BV(OCIE0A);
    TCCR0B = _BV(CS01) | _BV(CS00);
    for (uint8_t led = 0; led < N_LED; led++) settings.order[led] = led, settings.trim[led] = 255;
    settings.n_slot = N_LED;
    settings.alive_ms = ALIVE_MS;
    light_slot(10000, 1000000);
}

void light_slot(uint32_t slot_us, uint32_t fade_ppm) {
    uint32_t cycles = slot_us * (F_CPU / 1000000);
    uint16_t n_period = cycles / PERIOD;
    uint32_t n_fade = ((uint64_t)n_period * fade_ppm + 500000) / 1000000;
    uint8_t extra = cycles % PERIOD;
    settings.slot_us = slot_us;
    settings.n_period = n_period;
    settings.extra = extra;
    settings.n_fade = n_fade;
    settings.fade_rate = 0;
    if (n_fade) {
        uint32_t length = n_fade * PERIOD + (n_fade == n_period ? extra : 0);
        settings.fade_rate = ((1ULL << 32) + length / 2) / length;
    }
}

bool light_order_fades(void) {
    if (settings.n_fade)
        for (uint16_t i = 0; i < settings.n_slot; i++) {
            uint8_t from = settings.order[i], to = settings.order[after(i)];
            if (from != to && from != NONE && to != NONE && !((from ^ to) & 1)) return false;
        }
    return true;
}

void light_start(void) {
    uint8_t from = settings.order[0];

    light_dark(CAUSE_NONE);
    shift(NONE, NONE);
    latch();
    DDRB &= ~(OE_EVEN | OE_ODD); /* pull-ups hold them while the timer's outputs are made high */
    TCCR1B = 0;
    TCCR1A = FORCE_HIGH; /* normal mode, set by a compare: forced now */
    TCCR1C = _BV(FOC1A) | _BV(FOC1B);
    DDRB |= OE_EVEN | OE_ODD;
    OCR1A = OCR1B = NEVER;
    ICR1 = TOP;
    TCCR1A = PWM_ON;

    rounds_left = settings.rounds;
    rounds_done = 0;
    counted = false;
    last = fade_from = settings.n_period - 1;
    if (settings.n_fade) fade_from = settings.n_fade + 2 > settings.n_period ? 0 : last - settings.n_fade - 1;
    carrier_top = TOP + settings.extra;
    index_next = 0;
    on_led[0] = on_led[1] = held[0] = held[1] = NONE;
    on_slots[0] = on_slots[1] = 0;
    most_slots = MAX_ON_US / settings.slot_us;
    for (uint8_t led = 0; led < N_LED; led++) reckon(led);
    if (from != NONE) held[from & 1] = from;
    end = CAUSE_NONE;
    prepare();
    latch();

    carrier_fades = false;
    expect(last - 1, last, EVENT_LAST); /* of a dark slot before the first */
    timer2_phase = -TIMER2_LAG - 1;
    OCR2A = OCR2B = timer2_phase;
    TCCR2B = 0;
    TCNT1 = 0;
    TCNT2 = 0;
    TIFR1 = _BV(TOV1);
    TIMSK1 = _BV(TOIE1);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        running = true;
        TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);
        TCCR2B = _BV(CS20);
    }
}

void light_dark(enum cause why) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        TCCR1A = _BV(WGM11); /* the output enables are the port's again, */
        PORTB |= OE_EVEN | OE_ODD; /* which holds them high */
        TIMSK1 = 0;
        TCCR2A = BOTH_CLEAR;
        TCCR2B = _BV(FOC2A) | _BV(FOC2B) | _BV(CS20);
        running = false;
        cause = why;
    }
}

void light_constant(bool on) {
    if (on)
        PORTD |= LIGHT;
    else
        PORTD &= ~LIGHT;
}

void light_off(enum cause why) {
    light_constant(false);
    if (running) light_dark(why);
}

void light_alive(void) { alive_ms = settings.alive_ms + 1; }

ISR(TIMER0_COMPA_vect) {
    ticked = true;
    if (reset_uncalmed_ms < 255) reset_uncalmed_ms++;
    if (alive_ms && --alive_ms == 0) light_off(CAUSE_ALIVE);
}

bool light_is_running(void) { return running; }
bool light_is_constant(void) { return PORTD & LIGHT; }
enum cause light_cause(void) { return cause; }

uint32_t light_rounds_done(void) {
    uint32_t done;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { done = rounds_done; }
    return done;
}

bool light_is_well(void) {
    bool well;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        well = ticked && (!running || carrier_left != left_seen);
        if (well) ticked = false;
        left_seen = carrier_left;
    }
    return well;
}
