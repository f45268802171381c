/* What the host may ask for. A command changes nothing unless all of it is right. */
#include "command.h"

#include <avr/io.h>
#include <string.h>

#include "light.h"
#include "link.h"
#include "supply.h"

_Static_assert(2 * N_LED + 16 <= MAX_LINE, "lines are too short");

enum error { OK, CHECKSUM, TOO_LONG_LINE, UNKNOWN, ARGUMENT, BUSY, NEIGHBOURS, SUPPLY };

static const char error_words[][20] PROGMEM = {
    "", "checksum", "line too long", "unknown command", "bad argument", "busy", "neighbours in order",
    "supply is low",
};
static const char cause_words[][7] PROGMEM = {"none", "done", "stop", "alive", "limit", "late", "supply"};
static const char reset_words[][7] PROGMEM = {"power", "button", "hang", "supply"};

static uint16_t run_checksum; /* of the line that began the run */

/* ---- arguments -------------------------------------------------------------------------------------- */

/* Read a number and the space after it. */
static bool read_number(char **text, uint32_t most, uint32_t *number) {
    char *t = *text;
    uint32_t n = 0;
    for (; *t >= '0' && *t <= '9'; t++) {
        if (t - *text == 9) return false;
        n = 10 * n + (*t - '0');
    }
    if (t == *text || n > most || (*t && *t != ' ')) return false;
    if (*t) t++;
    *text = t, *number = n;
    return true;
}

static bool read_last(char *text, uint32_t most, uint32_t *number) {
    return read_number(&text, most, number) && !*text;
}

static int8_t read_hex(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

/* ---- commands --------------------------------------------------------------------------------------- */

static enum error set_slot(char *text) {
    uint32_t slot_us, fade_ppm;
    if (!read_number(&text, MAX_SLOT_US, &slot_us) || slot_us < MIN_SLOT_US) return ARGUMENT;
    if (!read_last(text, 1000000, &fade_ppm)) return ARGUMENT;
    light_slot(slot_us, fade_ppm);
    return OK;
}

/* Read an LED: A to Z, then a to v. */
static bool read_led(char c, uint8_t *led) {
    *led = c == '.' ? NONE : c >= 'a' ? c - 'a' + 26 : c - 'A';
    return c == '.' || (*led < N_LED && (c >= 'a' || c <= 'Z'));
}

/* Set the order from a slot on; it ends there. */
static enum error set_slots(uint16_t from, const char *text) {
    uint8_t n = strlen(text), led;
    if (n < 1 || from + n > MAX_SLOTS) return ARGUMENT;
    for (uint8_t i = 0; i < n; i++)
        if (!read_led(text[i], &led)) return ARGUMENT;
    for (uint8_t i = 0; i < n; i++) read_led(text[i], &settings.order[from + i]);
    settings.n_slot = from + n;
    return OK;
}

static enum error set_order(char *text) { return set_slots(0, text); }

/* A line is too short for the longest orders. */
static enum error set_more(char *text) {
    uint32_t from;
    if (!read_number(&text, settings.n_slot, &from) || from < 1) return ARGUMENT;
    return set_slots(from, text);
}

static enum error set_trim(char *text) {
    if (strlen(text) != 2 * N_LED) return ARGUMENT;
    for (uint8_t i = 0; i < 2 * N_LED; i++)
        if (read_hex(text[i]) < 0) return ARGUMENT;
    for (uint8_t led = 0; led < N_LED; led++, text += 2)
        settings.trim[led] = read_hex(text[0]) << 4 | read_hex(text[1]);
    return OK;
}

static enum error set_alive(char *text) {
    uint32_t ms;
    if (!read_last(text, MAX_ALIVE_MS, &ms) || ms < MIN_ALIVE_MS) return ARGUMENT;
    settings.alive_ms = ms;
    return OK;
}

static enum error set_rounds(char *text) {
    return read_last(text, MAX_ROUNDS, &settings.rounds) ? OK : ARGUMENT;
}

static enum error set_sync(char *text) {
    uint32_t on;
    if (!read_last(text, 1, &on)) return ARGUMENT;
    settings.sync = on;
    return OK;
}

static enum error set_light(char *text) {
    uint32_t on;
    if (!read_last(text, 1, &on)) return ARGUMENT;
    if (on && supply_is_low()) return SUPPLY;
    light_constant(on);
    return OK;
}

static enum error ask(char *text) { return *text ? ARGUMENT : OK; }

static enum error run(char *text) {
    if (*text) return ARGUMENT;
    if (light_is_running()) /* the same line again: its answer was lost */
        return link_checksum() == run_checksum ? OK : BUSY;
    if (!light_order_fades()) return NEIGHBOURS;
    if (supply_is_low()) return SUPPLY;
    light_start();
    run_checksum = link_checksum();
    return OK;
}

static enum error stop(char *text) {
    if (*text) return ARGUMENT;
    if (light_is_running()) light_dark(CAUSE_STOP);
    return OK;
}

/* ---- answers ---------------------------------------------------------------------------------------- */

static void tell(const char *name_P, uint32_t number) {
    link_put(' ');
    link_words(name_P);
    link_put('=');
    link_number(number);
}

static void tell_nothing(void) {}

static void tell_hello(void) {
    link_words(PSTR(" " FIRMWARE));
    tell(PSTR("protocol"), PROTOCOL);
    tell(PSTR("leds"), N_LED);
    tell(PSTR("slots"), MAX_SLOTS);
    tell(PSTR("alive_ms"), settings.alive_ms);
    tell(PSTR("max_on_us"), MAX_ON_US);
}

static void tell_slot(void) {
    tell(PSTR("periods"), settings.n_period);
    tell(PSTR("extra"), settings.extra);
    tell(PSTR("fade"), settings.n_fade);
}

static void tell_status(void) {
    bool running = light_is_running();
    tell(PSTR("run"), running);
    tell(PSTR("rounds"), light_rounds_done());
    tell(PSTR("light"), light_is_constant());
    link_words(PSTR(" cause="));
    link_words(cause_words[running ? CAUSE_NONE : light_cause()]);
}

/* ---- lines ------------------------------------------------------------------------------------------ */

static const struct command {
    char name[8];
    bool at_rest; /* refused during a run */
    enum error (*obey)(char *rest);
    void (*tell)(void); /* after OK */
} commands[] = {
    {"HELLO", false, ask, tell_hello},          {"STATUS", false, ask, tell_status},
    {"SLOT", true, set_slot, tell_slot},        {"ORDER", true, set_order, tell_nothing},
    {"TRIM", true, set_trim, tell_nothing},     {"ROUNDS", true, set_rounds, tell_nothing},
    {"SYNC", true, set_sync, tell_nothing},     {"LIGHT", false, set_light, tell_nothing},
    {"RUN", false, run, tell_nothing},          {"STOP", false, stop, tell_nothing},
    {"MORE", true, set_more, tell_nothing},     {"ALIVE", false, set_alive, tell_nothing},
};
#define N_COMMAND (sizeof commands / sizeof *commands)

static void refuse(const char *who, enum error error) {
    link_text(who);
    link_words(PSTR(" ERR "));
    link_number(error);
    link_put(' ');
    link_words(error_words[error]);
    link_end();
}

/* Obey a line `number name rest`. */
static void answer(char *text) {
    char *number = text, *name = strchr(text, ' '), *rest;
    uint32_t value;
    if (name) *name++ = 0;
    if (!name || !read_last(number, 65535, &value)) {
        refuse("-", ARGUMENT);
        return;
    }
    rest = strchr(name, ' ');
    if (rest) *rest++ = 0;
    else rest = name + strlen(name);
    for (const struct command *c = commands; c < commands + N_COMMAND; c++)
        if (!strcmp(name, c->name)) {
            enum error error = c->at_rest && light_is_running() ? BUSY : c->obey(rest);
            if (error) {
                refuse(number, error);
                return;
            }
            link_text(number);
            link_words(PSTR(" OK"));
            c->tell();
            link_end();
            return;
        }
    refuse(number, UNKNOWN);
}

void command_boot(enum reset cause) {
    link_words(PSTR("# BOOT " FIRMWARE));
    tell(PSTR("protocol"), PROTOCOL);
    tell(PSTR("reset"), reset_flags);
    link_words(PSTR(" cause="));
    link_words(reset_words[cause]);
    link_end();
}

void command_poll(void) {
    char *text;
    switch (link_read(&text)) {
        case NOTHING: return;
        case BAD_CHECKSUM: refuse("-", CHECKSUM); return;
        case TOO_LONG: refuse("-", TOO_LONG_LINE); return;
        case LINE:
            light_alive();
            answer(text);
    }
}
