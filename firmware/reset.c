/* Why the program started, and the watchdog that may make it start anew.
 *
 * The Uno's bootloader clears MCUSR, so RAM that no start clears tells what a reset ended: none that makes sense
 * after power was off; else a time without calm, a low supply, or neither: the button or the host's port.
 * A program that hangs with interrupts off looks like the button, unless MCUSR is there.
 */
#include "reset.h"

#include <avr/io.h>
#include <avr/wdt.h>

#include "light.h"

#define NOINIT __attribute__((section(".noinit")))
#define MARK 0x52696E67UL /* "Ring" */
#define HUNG_MS 8         /* of the watchdog's 15; the program is calm every millisecond, nearly */

uint8_t reset_flags NOINIT;
volatile uint8_t reset_uncalmed_ms NOINIT;
static uint32_t mark NOINIT;
static uint8_t is_low NOINIT;

/* Runs before everything else: after a reset by the watchdog it is still on. */
void begin(void) __attribute__((naked, used, section(".init3")));
void begin(void) {
    reset_flags = MCUSR;
    MCUSR = 0;
    wdt_enable(WDTO_15MS);
}

enum reset reset_cause(void) {
    enum reset cause = RESET_BUTTON;
    if (mark != MARK || reset_flags & _BV(PORF)) cause = RESET_POWER;
    else if (is_low || reset_flags & _BV(BORF)) cause = RESET_SUPPLY;
    else if (reset_uncalmed_ms >= HUNG_MS || reset_flags & _BV(WDRF)) cause = RESET_HANG;
    mark = MARK;
    is_low = 0;
    reset_uncalmed_ms = 0;
    return cause;
}

void reset_watch(void) {
    if (!light_is_well()) return;
    reset_uncalmed_ms = 0;
    wdt_reset();
}

void reset_low_supply(void) { is_low = 1; }
