/* Runs the ring's firmware on a simulated ATmega328P.
 *
 *     bench ring.elf [--vcd FILE] [--pty]
 *
 * Commands come on standard input, one a line; times are simulated microseconds:
 *
 *     wait US       let time pass                      send HEX      bytes to the UART, at its own pace
 *     beat US HEX   send these bytes every US          answer US     wait until all is sent and a line has come
 *                                                                    from the UART, or so long
 *     reset         press the reset button             hang          spin where the program stands
 *     freeze        the same with interrupts off       stall         timer 1 interrupts no more
 *     cut           the cable is out, both ways        join          it is in again
 *     rail MV       the supply of chip, shift registers and LEDs; below 2.7 V the chip is held in reset
 *     apart MV      what shift registers and LEDs have of their own instead; 0 for nothing
 *     boot US       from now on a bootloader runs so long after a press of the button, and clears MCUSR
 *     mark          say the time                       quit
 *
 * On standard output, with the time before each: lines from the UART; "lit" and "dark" when an output enable
 * starts to go low, or has been high for a millisecond; "reset". With --pty the UART is a terminal whose name
 * is the first line of the output; time then runs no faster than it does outside, and waits a while when the
 * host is silent, so that a busy computer does not look like a lost host. --vcd records the pins.
 */
#include <fcntl.h>
#include <pty.h>
#include <poll.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_io.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "timers.h"

#define MHZ 16
#define MS (1000 * MHZ)
#define ROOM 4096              /* bytes on their way to the UART */
#define BYTE_CYCLES 320        /* start, 8 bits, stop at 500 kbaud */
#define SILENCE (12 * MS)      /* of the host, after which time waits for it */
#define PATIENCE_MS 1000       /* so long, outside */
#define SPIN 0xCFFF            /* rjmp to itself */

/* Registers and their bits, memory, and limits of the supply. */
enum { TIMSK1 = 0x6F, MCUSR = 0x54, UCSR0A = 0xC0, UBRR0L = 0xC4, U2X = 2 };
enum { PORF = 1, EXTRF = 2, BORF = 4, WDRF = 8 };
enum { RAM = 0x100, RAM_END = 0x900, PAGE = 0x100 };
enum { BROWN_OUT_MV = 2700, FORGET_MV = 1000 };

static avr_t *avr;
static FILE *vcd;
static avr_irq_t *uart_in;
static unsigned char bytes[ROOM];
static unsigned head, tail;
static char text[512], beat[512];
static unsigned text_length;
static avr_cycle_count_t beat_cycles, last_lit, last_heard;
static int lit, answered, cut, spins, terminal = -1;
static avr_flashaddr_t spin_at;
static uint16_t spun_over;
static avr_uart_t *uart;
static int rail_mv = 5000, apart_mv, lowest_mv, reset_by = PORF;
static avr_cycle_count_t boot_cycles;

static double now_us(void) { return (double)avr->cycle / MHZ; }

/* ---- pins ------------------------------------------------------------------------------------------- */

static void on_change(avr_cycle_count_t when, enum signal signal, int value) {
    if (vcd) fprintf(vcd, "#%llu\n%d%c\n", (unsigned long long)when * 625, value, '!' + signal);
    if ((signal == OE_EVEN || signal == OE_ODD) && !value) {
        if (!lit) printf("%.4f lit\n", (double)when / MHZ);
        lit = 1;
        last_lit = when;
    }
}

static int byte_cycles(void);

static avr_cycle_count_t look_for_dark(avr_t *a, avr_cycle_count_t when, void *p) {
    (void)p;
    byte_cycles();
    if (lit && a->cycle - last_lit > MS && timers_level(OE_EVEN) && timers_level(OE_ODD)) {
        printf("%.4f dark\n", (double)last_lit / MHZ);
        lit = 0;
    }
    return when + MS / 2;
}

static void open_vcd(const char *path) {
    if (!(vcd = fopen(path, "w"))) perror(path), exit(1);
    setvbuf(vcd, 0, _IOFBF, 1 << 20);
    fprintf(vcd, "$timescale 100 ps $end\n$scope module ring $end\n");
    for (int s = 0; s < N_SIGNAL; s++) fprintf(vcd, "$var wire 1 %c %s $end\n", '!' + s, signal_name[s]);
    fprintf(vcd, "$upscope $end\n$enddefinitions $end\n#0\n$dumpvars\n");
    for (int s = 0; s < N_SIGNAL; s++) fprintf(vcd, "%d%c\n", s == OE_EVEN || s == OE_ODD, '!' + s);
    fprintf(vcd, "$end\n");
}

/* ---- UART ------------------------------------------------------------------------------------------- */

/* simavr 1.6 counts a parity bit where there is none: tell it how long a byte takes. */
static int byte_cycles(void) {
    int cycles = 10 * (avr->data[UCSR0A] & U2X ? 8 : 16) * (avr->data[UBRR0L] + 1);
    return uart->cycles_per_byte = cycles;
}

static avr_cycle_count_t feed(avr_t *a, avr_cycle_count_t when, void *p) {
    (void)a, (void)p;
    if (head == tail) return 0;
    int spoiled = byte_cycles() == BYTE_CYCLES ? 0 : 0x55; /* what another speed makes of a byte, say */
    avr_raise_irq(uart_in, bytes[tail++ % ROOM] ^ spoiled);
    last_heard = when;
    return when + BYTE_CYCLES;
}

static void push(unsigned char byte) {
    if (head - tail < ROOM) bytes[head++ % ROOM] = byte;
    if (!avr_cycle_timer_status(avr, feed, 0)) avr_cycle_timer_register(avr, BYTE_CYCLES, feed, 0);
}

static void push_hex(const char *hex) {
    for (unsigned byte; sscanf(hex, "%2x", &byte) == 1; hex += 2) push(byte);
}

static avr_cycle_count_t beat_again(avr_t *a, avr_cycle_count_t when, void *p) {
    (void)a, (void)p;
    push_hex(beat);
    return when + beat_cycles;
}

static void on_byte(struct avr_irq_t *irq, uint32_t value, void *p) {
    (void)irq, (void)p;
    if (terminal >= 0) {
        char c = value;
        if (!cut && write(terminal, &c, 1) != 1) {}
        return;
    }
    if (value != '\n') {
        if (text_length < sizeof text - 1) text[text_length++] = value;
        return;
    }
    text[text_length] = 0;
    text_length = 0;
    answered = 1;
    printf("%.4f > %s\n", now_us(), text);
}

/* ---- processor -------------------------------------------------------------------------------------- */

static void spin(void) {
    if (spins) return;
    spins = 1;
    spin_at = avr->pc;
    memcpy(&spun_over, avr->flash + spin_at, 2);
    memcpy(avr->flash + spin_at, &(uint16_t){SPIN}, 2);
    avr->state = cpu_Running;
}

static avr_cycle_count_t go_on(avr_t *a, avr_cycle_count_t when, void *p) {
    (void)when, (void)p;
    if (spins) memcpy(a->flash + spin_at, &spun_over, 2);
    spins = 0;
    return 0;
}

/* After the other modules' reset: what no reset clears, or a bootloader leaves. */
static avr_cycle_count_t start(avr_t *a, avr_cycle_count_t when, void *p) {
    (void)when, (void)p;
    /* Don't look at the level of INT0 and INT1 in every cycle: the ring uses no such interrupt. */
    for (int pin = 0; pin < 2; pin++) avr_extint_set_strict_lvl_trig(a, pin, 0);
    a->data[MCUSR] = boot_cycles ? 0 : reset_by;
    if (boot_cycles) a->data[UCSR0A] |= U2X;
    reset_by = WDRF;
    return 0;
}

/* No pin of the ring is an output as long as the chip is held in reset, or a bootloader waits. */
static void hold(void) {
    int waits = boot_cycles && reset_by == EXTRF;
    if (rail_mv < BROWN_OUT_MV || waits) spin();
    if (!waits) return;
    for (int i = 0; i < PAGE; i++) avr->data[RAM + i] = rand();
    avr_cycle_timer_register(avr, boot_cycles, go_on, 0);
}

static void set_supply(void) {
    avr->vcc = avr->avcc = rail_mv;
    timers_supply(avr, rail_mv, apart_mv ? apart_mv : rail_mv);
}

static void set_rail(int mv) {
    int was = rail_mv;
    rail_mv = mv;
    if (was >= BROWN_OUT_MV) lowest_mv = mv;
    if (mv < lowest_mv) lowest_mv = mv;
    set_supply();
    if (mv < FORGET_MV)
        for (int i = RAM; i < RAM_END; i++) avr->data[i] = rand();
    if ((was < BROWN_OUT_MV) == (mv < BROWN_OUT_MV)) return;
    reset_by = lowest_mv < FORGET_MV ? PORF : BORF;
    avr_reset(avr);
}

static void on_reset(struct avr_io_t *io) {
    (void)io;
    go_on(avr, 0, 0);
    avr->run_cycle_limit = MS / 10;
    if (head != tail) avr_cycle_timer_register(avr, BYTE_CYCLES, feed, 0);
    avr_cycle_timer_register(avr, MS / 2, look_for_dark, 0);
    avr_cycle_timer_register(avr, 1, start, 0);
    hold();
    if (beat_cycles) avr_cycle_timer_register(avr, beat_cycles, beat_again, 0);
    printf("%.4f reset\n", now_us());
}

static void no_sleep(avr_t *a, avr_cycle_count_t cycles) { (void)a, (void)cycles; }

static void run_until(avr_cycle_count_t end, int stop_at_answer) {
    while (avr->cycle < end && !(stop_at_answer && answered)) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) {
            fprintf(stderr, "bench: the processor stopped\n");
            exit(1);
        }
    }
}

/* ---- commands --------------------------------------------------------------------------------------- */

static int obey(char *line) {
    unsigned long us;
    int skip = 0, mv;
    if (sscanf(line, "wait %lu", &us) == 1) run_until(avr->cycle + us * MHZ, 0);
    else if (sscanf(line, "answer %lu", &us) == 1) {
        while (head != tail) run_until(avr->cycle + BYTE_CYCLES, 0);
        run_until(avr->cycle + us * MHZ, 1);
    }
    else if (!strncmp(line, "send ", 5)) answered = 0, push_hex(line + 5);
    else if (sscanf(line, "beat %lu %n", &us, &skip) == 1) {
        beat_cycles = us * MHZ;
        snprintf(beat, sizeof beat, "%s", skip ? line + skip : "");
        avr_cycle_timer_cancel(avr, beat_again, 0);
        if (us) avr_cycle_timer_register(avr, beat_cycles, beat_again, 0);
    }
    else if (sscanf(line, "rail %d", &mv) == 1) set_rail(mv);
    else if (sscanf(line, "apart %d", &mv) == 1) apart_mv = mv, set_supply();
    else if (sscanf(line, "boot %lu", &us) == 1) boot_cycles = us * MHZ;
    else if (!strcmp(line, "mark")) printf("%.4f mark\n", now_us());
    else if (!strcmp(line, "reset")) reset_by = EXTRF, avr_reset(avr);
    else if (!strcmp(line, "hang")) spin();
    else if (!strcmp(line, "freeze")) spin(), avr->sreg[S_I] = 0;
    else if (!strcmp(line, "stall")) avr->data[TIMSK1] = 0;
    else if (!strcmp(line, "cut")) cut = 1;
    else if (!strcmp(line, "join")) cut = 0;
    else if (!strcmp(line, "quit")) return 0;
    else fprintf(stderr, "bench: what is \"%s\"?\n", line), exit(1);
    return 1;
}

static int obey_next(void) {
    static char line[8192];
    if (!fgets(line, sizeof line, stdin)) return 0;
    line[strcspn(line, "\n")] = 0;
    return obey(line);
}

static long long wall_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

/* Run beside a host on the terminal, millisecond by millisecond. */
static void accompany(void) {
    struct pollfd input[2] = {{.fd = terminal, .events = POLLIN}, {.fd = 0, .events = POLLIN}};
    long long due = wall_ns();
    int patient = 0;
    for (;;) {
        int wait = patient && avr->cycle - last_heard > SILENCE ? PATIENCE_MS : 0;
        if (poll(input, 2, wait) == 0 && wait) patient = 0;
        if (input[1].revents && !obey_next()) break;
        if (input[0].revents & POLLIN) {
            unsigned char chunk[256];
            ssize_t n = read(terminal, chunk, sizeof chunk);
            for (ssize_t i = 0; i < n && !cut; i++) push(chunk[i]);
            patient = !cut;
        }
        run_until(avr->cycle + MS, 0);
        due += 1000000;
        long long ahead = due - wall_ns();
        if (ahead > 0) usleep(ahead / 1000);
        else due -= ahead;
    }
}

int main(int argc, char **argv) {
    elf_firmware_t firmware = {0};
    static avr_io_t module = {.kind = "bench", .reset = on_reset};
    int with_terminal = 0;
    for (int i = 2; i < argc; i++) {
        if (!strcmp(argv[i], "--pty")) with_terminal = 1;
        if (!strcmp(argv[i], "--vcd") && i + 1 < argc) open_vcd(argv[++i]);
    }
    if (argc < 2 || elf_read_firmware(argv[1], &firmware)) return 2;
    setvbuf(stdout, 0, with_terminal ? _IOLBF : _IOFBF, 1 << 16);
    if (with_terminal) setvbuf(stdin, 0, _IONBF, 0); /* so that poll sees each command */
    avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    firmware.frequency = MHZ * 1000000;
    avr_load_firmware(avr, &firmware);
    avr->log = LOG_ERROR;
    avr->sleep = no_sleep;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &(uint32_t){0});
    uart_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, 0);
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "uart")) uart = (avr_uart_t *)io;
    timers_attach(avr, on_change);
    set_supply();
    avr_register_io(avr, &module);
    if (with_terminal) {
        int other;
        char name[256];
        struct termios raw;
        if (openpty(&terminal, &other, name, 0, 0)) perror("openpty"), exit(1);
        tcgetattr(other, &raw);
        cfmakeraw(&raw);
        tcsetattr(other, TCSANOW, &raw);
        fcntl(terminal, F_SETFL, O_NONBLOCK); /* a UART does not wait for whoever reads */
        printf("%s\n", name);
    }
    avr_reset(avr);
    if (with_terminal) accompany();
    else while (obey_next());
    if (vcd) fprintf(vcd, "#%llu\n", (unsigned long long)avr->cycle * 625), fclose(vcd);
    return 0;
}
