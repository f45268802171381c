/* Firmware of the ring: ATmega328P (Arduino Uno), 16 MHz. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "command.h"
#include "light.h"
#include "link.h"

static uint8_t reset_flags __attribute__((section(".noinit")));

/* Runs before everything else: after a reset by the watchdog it is still on. */
void begin(void) __attribute__((naked, used, section(".init3")));
void begin(void) {
    reset_flags = MCUSR;
    MCUSR = 0;
    wdt_enable(WDTO_15MS);
}

int main(void) {
    light_init();
    link_init();
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    command_boot(reset_flags);
    for (;;) {
        command_poll();
        if (light_is_well()) wdt_reset();
        cli();
        if (link_is_idle()) {
            sleep_enable();
            sei(); /* the instruction after it still runs before an interrupt */
            sleep_cpu();
            sleep_disable();
        }
        sei();
    }
}
