/* Lines over the UART. A line is text, '*', four hexadecimal digits of CRC-16/CCITT-FALSE, '\n'. */
#include "link.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/crc16.h>

#include "reset.h"

#define ROOM 128 /* bytes, a power of 2 */
#define CRC_START 0xFFFF
#define DEAF (_BV(RXEN0) | _BV(TXEN0))
#define HEARS (DEAF | _BV(RXCIE0))

static volatile uint8_t waiting[ROOM];
static volatile uint8_t head, tail;
static char line[MAX_LINE + 1];
static uint8_t length; /* MAX_LINE + 1: too long */
static uint16_t line_crc, answer_crc = CRC_START;

void link_init(void) {
    UCSR0A = 0; /* a bootloader may have doubled the speed */
    UBRR0 = F_CPU / 16 / BAUD - 1;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = HEARS;
}

/* A byte for which there is no room is lost, and with it the line: its checksum fails. Bytes are then not
 * heard until the program has read the others, so that a flood does not take all its time. */
ISR(USART_RX_vect) {
    uint8_t byte = UDR0, then = (head + 1) & (ROOM - 1);
    if (then != tail) {
        waiting[head] = byte;
        head = then;
    } else {
        UCSR0B = DEAF;
    }
}

bool link_is_idle(void) { return head == tail; }

static uint16_t crc_of(const char *text, uint8_t n) {
    uint16_t crc = CRC_START;
    while (n--) crc = _crc_xmodem_update(crc, *text++);
    return crc;
}

static char hex_digit(uint8_t value) { return value < 10 ? '0' + value : 'A' + value - 10; }

/* Split off the checksum; say if it is right. */
static bool checked(void) {
    if (length < 5 || line[length - 5] != '*') return false;
    uint16_t crc = crc_of(line, length - 5);
    for (uint8_t i = 1; i <= 4; i++, crc >>= 4)
        if (line[length - i] != hex_digit(crc & 15)) return false;
    return true;
}

enum received link_read(char **text) {
    for (uint8_t most = 16; most && !link_is_idle(); most--) { /* the main loop has a watchdog to calm */
        char c = waiting[tail];
        tail = (tail + 1) & (ROOM - 1);
        if (c != '\n' && c != '\r') {
            if (length < MAX_LINE) line[length] = c;
            if (length <= MAX_LINE) length++;
            continue;
        }
        uint8_t n = length; /* a whole line */
        bool right = n <= MAX_LINE && checked();
        length = 0;
        if (n == 0) continue;
        if (n > MAX_LINE) return TOO_LONG;
        if (!right) return BAD_CHECKSUM;
        line_crc = crc_of(line, n - 5);
        line[n - 5] = 0;
        *text = line;
        return LINE;
    }
    if (link_is_idle()) UCSR0B = HEARS;
    return NOTHING;
}

uint16_t link_checksum(void) { return line_crc; }

static void send(char c) {
    reset_watch(); /* an answer has an end, but takes long in the shortest slots */
    while (!(UCSR0A & _BV(UDRE0)));
    UDR0 = c;
}

void link_put(char c) {
    answer_crc = _crc_xmodem_update(answer_crc, c);
    send(c);
}

void link_text(const char *text) {
    while (*text) link_put(*text++);
}

void link_words(const char *flash_text) {
    for (char c; (c = pgm_read_byte(flash_text)); flash_text++) link_put(c);
}

/* By subtraction: the chip does not divide. */
void link_number(uint32_t number) {
    static const uint32_t powers[] PROGMEM = {
        1000000000, 100000000, 10000000, 1000000, 100000, 10000, 1000, 100, 10, 1,
    };
    bool begun = false;
    for (uint8_t i = 0; i < sizeof powers / sizeof *powers; i++) {
        uint32_t power = pgm_read_dword(&powers[i]);
        char digit = '0';
        for (; number >= power; number -= power) digit++;
        begun |= digit > '0' || power == 1;
        if (begun) link_put(digit);
    }
}

void link_end(void) {
    uint16_t crc = answer_crc;
    send('*');
    for (int8_t shift = 12; shift >= 0; shift -= 4) send(hex_digit((crc >> shift) & 15));
    send('\n');
    answer_crc = CRC_START;
}
