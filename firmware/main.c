/* Firmware of the ring: ATmega328P (Arduino Uno), 16 MHz. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#include "command.h"
#include "light.h"
#include "link.h"
#include "reset.h"
#include "supply.h"

int main(void) {
    light_init();
    supply_init();
    link_init();
    set_sleep_mode(SLEEP_MODE_IDLE);
    enum reset cause = reset_cause();
    sei();
    command_boot(cause);
    for (;;) {
        command_poll();
        reset_watch();
        if (supply_is_low()) {
            reset_low_supply();
            light_off(CAUSE_SUPPLY);
        }
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
