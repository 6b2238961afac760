/* An Arduino Uno in simavr behind a pseudo-terminal: the firmware is real, its port opens like a serial port.
 *
 *   cc -O2 -o uno uno.c -I/usr/include/simavr -lsimavr
 *   uno [options] FIRMWARE.elf        prints "READY /dev/pts/N" once the port may be opened
 *
 *   --link PATH       symbolic link to the port, removed at the end
 *   --adc FILE        a line holds one count 0..1023 for each of A0, A1, ...; the n-th conversion of a pin gets
 *                     the n-th line, and after the last line the first one again
 *   --low PIN         digital pin 0..7 is connected to ground
 *   --adc-times FILE  writes the simulated second of every conversion of A0
 *   --speed 1|0       1: as fast as the wall clock (default); 0: flat out, waiting for the reader, losing nothing
 *   --wait-open       the board is powered when the port is first opened, so that no byte is missed
 *   --reset-on-open   opening the port resets the board, as DTR does on a real Uno; to be closed and opened again
 *                     within a millisecond goes unnoticed
 *   --hold S          after power or reset nothing happens for S simulated seconds, as in a boot loader
 *   --check-baud      bytes are garbled while the port's speed is more than 4 % away from the board's
 *   --seconds S       stop the board after S simulated seconds, wait until the port is closed, end
 *
 * SIGUSR1 is the reset button, SIGTERM ends it, SIGKILL pulls the plug. At the end one line of counts on stderr.
 * One thread: the core runs for 1 ms of simulated time, then the port is served and the clock waited for.
 */
#define _GNU_SOURCE
#include <asm/termbits.h> /* termios2 with numeric speeds; it must not meet <termios.h> */
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include "avr_adc.h"
#include "avr_ioport.h"
#include "avr_uart.h"
#include "sim_avr.h"
#include "sim_elf.h"

enum { HZ = 16000000, SLICE = HZ / 1000, VREF_MV = 5000, PINS = 6, QUEUE = 1 << 16 };

static struct {
    const char *link, *adc, *adc_times;
    double speed, hold, seconds;
    int wait_open, reset_on_open, check_baud, low;
} option = {.speed = 1};

static avr_t *avr;
static avr_uart_t *uart;
static avr_irq_t *to_board, *to_pin[PINS];
static uint16_t (*counts)[PINS];
static size_t rows, row[PINS];
static FILE *adc_times;
static int port = -1, is_open, flushed, board_takes = 1, same_speed = 1;
static double connected_at;
static uint8_t from_board[QUEUE], from_host[4096];
static uint32_t queued, sent;
static size_t received, given;
static avr_cycle_count_t held, to_hold;
static volatile sig_atomic_t stop, button;
static struct { unsigned long long conversions, out, in, dropped, resets, opens, slips; } count;

static void fail(const char *what)
{
    fprintf(stderr, "uno: %s: %s\n", what, errno ? strerror(errno) : "cannot be used");
    exit(2);
}

static void on_stop(int signal) { (void)signal; stop = 1; }
static void on_button(int signal) { (void)signal; button = 1; }
static double simulated(void) { return (double)(avr->cycle + held) / HZ; }

static double wall(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

/* ---- analogue pins ---- */

static void read_counts(const char *path)
{
    char *line = NULL;
    size_t room = 0;
    FILE *file = fopen(path, "r");
    if (!file) fail(path);
    while (getline(&line, &room, file) > 0) {
        if (rows % 4096 == 0 && !(counts = realloc(counts, (rows + 4096) * sizeof *counts))) fail(path);
        char *at = line, *end;
        for (int pin = 0; pin < PINS; pin++, at = end) counts[rows][pin] = strtoul(at, &end, 10);
        rows++;
    }
    free(line);
    fclose(file);
    errno = 0;
    if (!rows) fail(path);
}

static void on_conversion(struct avr_irq_t *irq, uint32_t mux, void *unused)
{
    (void)irq, (void)unused;
    uint32_t kind = mux & 7, pin = mux >> 19; /* a packed avr_adc_mux_t */
    if (kind != ADC_MUX_SINGLE || pin >= PINS) return;
    count.conversions++;
    if (adc_times && pin == 0) fprintf(adc_times, "%.9f\n", simulated());
    if (!rows) return;
    /* simavr takes millivolts and rounds mV * 1023 / vref down: rounding up gives every count back as itself. */
    avr_raise_irq(to_pin[pin], (counts[row[pin]++ % rows][pin] * VREF_MV + 1022) / 1023);
}

/* ---- the board's UART ---- */

static uint32_t cycles_per_bit(void)
{
    uint32_t ubrr = avr_regbit_get(avr, uart->ubrrl) | avr_regbit_get(avr, uart->ubrrh) << 8;
    return (ubrr + 1) * (avr_regbit_get(avr, uart->u2x) ? 8 : 16);
}

/* simavr counts a parity bit in every frame: 11 bits, where 8N1 has 10. */
static void set_frame_length(void) { uart->cycles_per_byte = 10 * cycles_per_bit(); }

static uint8_t on_the_line(uint8_t byte) { return same_speed ? byte : byte * 29u + 0x91u; }

static void on_byte(struct avr_irq_t *irq, uint32_t byte, void *unused)
{
    (void)irq, (void)unused;
    set_frame_length(); /* this hook runs before simavr uses the value */
    count.out++;
    if (!is_open || queued - sent == QUEUE)
        count.dropped++;
    else
        from_board[queued++ % QUEUE] = on_the_line(byte);
}

static void on_xon(struct avr_irq_t *irq, uint32_t on, void *unused)
{
    (void)irq, (void)on, (void)unused;
    board_takes = 1;
}

static void on_xoff(struct avr_irq_t *irq, uint32_t on, void *unused)
{
    (void)irq, (void)unused;
    if (on) board_takes = 0;
}

/* ---- the port ---- */

static void forget_bytes(void)
{
    sent = queued;
    given = received = 0;
}

static void reset_board(void)
{
    avr_reset(avr);
    avr->run_cycle_limit = 64; /* avr_reset puts it back to 1, which costs a third more processor time */
    avr_regbit_set(avr, avr->reset_flags.extrf);
    forget_bytes();
    board_takes = 1;
    to_hold = option.hold * HZ;
    count.resets++;
}

static void make_port(char *name, size_t room)
{
    struct termios2 mode;
    port = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (port < 0 || grantpt(port) || unlockpt(port) || ptsname_r(port, name, room)) fail("pseudo-terminal");
    int terminal = open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (terminal < 0 || ioctl(terminal, TCGETS2, &mode)) fail(name);
    /* Raw before anybody opens it: a terminal that echoes sends the board its own output. */
    mode.c_iflag = mode.c_oflag = mode.c_lflag = 0;
    mode.c_cflag = CS8 | CREAD | CLOCAL | B115200;
    mode.c_cc[VMIN] = 1, mode.c_cc[VTIME] = 0;
    if (ioctl(terminal, TCSETS2, &mode)) fail(name);
    close(terminal); /* from now on POLLHUP says that no program has the port open */
    fcntl(port, F_SETFL, O_NONBLOCK);
    if (ioctl(port, TIOCPKT, &(int){1})) fail(name); /* tells us when the client flushes */
    if (!option.link) return;
    char old[64]; /* a board whose plug was pulled has left its link behind */
    if (readlink(option.link, old, sizeof old) > 0) unlink(option.link);
    if (symlink(name, option.link)) fail(option.link);
}

static void look_at_speed(void)
{
    struct termios2 mode;
    if (!option.check_baud || ioctl(port, TCGETS2, &mode)) return;
    double board = (double)HZ / cycles_per_bit();
    same_speed = mode.c_ospeed > board * 0.96 && mode.c_ospeed < board * 1.04;
}

static void send_to_host(void)
{
    while (sent != queued && !stop) {
        uint32_t at = sent % QUEUE, n = queued - sent < QUEUE - at ? queued - sent : QUEUE - at;
        ssize_t done = write(port, from_board + at, n);
        if (done > 0) {
            sent += done;
            continue;
        }
        if (option.speed > 0 || (errno != EAGAIN && errno != EINTR)) return;
        struct pollfd room = {.fd = port, .events = POLLOUT};
        poll(&room, 1, 50);
        if (room.revents & POLLHUP) return;
    }
}

/* In packet mode a read gives one byte of news first; 0 says that the client's bytes follow. */
static void receive_from_host(void)
{
    ssize_t n = read(port, from_host, sizeof from_host);
    given = received = 0;
    if (n <= 0) return;
    if (from_host[0] == TIOCPKT_DATA) {
        given = 1, received = n;
        count.in += n - 1;
    } else if (from_host[0] & TIOCPKT_FLUSHREAD) {
        flushed = 1;
    }
}

static void serve_port(void)
{
    struct pollfd look = {.fd = port, .events = POLLIN};
    poll(&look, 1, 0);
    if (look.revents & POLLHUP) {
        is_open = flushed = 0;
        connected_at = 0;
        forget_bytes();
        return;
    }
    if (!connected_at) connected_at = wall();
    if (given == received) receive_from_host();
    if (!is_open) {
        /* A client may throw away what came while it set up the port, pyserial does: only then is it open. */
        if (!flushed && wall() - connected_at < 0.5) return;
        is_open = 1;
        count.opens++;
        if (option.reset_on_open) reset_board();
    }
    look_at_speed();
    while (given < received && board_takes) avr_raise_irq(to_board, on_the_line(from_host[given++]));
    send_to_host();
}

/* ---- power, time ---- */

static void no_sleep(avr_t *a, avr_cycle_count_t n) { (void)a, (void)n; } /* run() keeps the time */

static void power_up(const char *firmware)
{
    elf_firmware_t code = {0};
    uint32_t no_flags = 0; /* else simavr sleeps on every idle look at the UART, and prints all lines on stdout */
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr || avr_init(avr)) fail("atmega328p");
    avr->log = LOG_WARNING; /* the default hides even the message of an abort */
    if (elf_read_firmware(firmware, &code)) fail(firmware);
    avr_load_firmware(avr, &code);
    avr->codeend = avr->flashend;
    avr->frequency = HZ; /* an Arduino .elf names neither clock nor voltages, and loading clears them */
    avr->vcc = avr->avcc = avr->aref = VREF_MV;
    avr->sleep = no_sleep;
    avr->run_cycle_limit = 64;
    to_hold = option.hold * HZ;

    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "uart")) uart = (avr_uart_t *)io;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &no_flags);
    avr_ioport_external_t to_ground = {.name = 'D', .mask = option.low};
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &to_ground);
    to_board = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, 0);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_xon, 0);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_xoff, 0);
    for (int pin = 0; pin < PINS; pin++)
        to_pin[pin] = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + pin);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), on_conversion, 0);
}

/* Sleep until the wall clock has caught up; where it is far ahead, restart the count instead of racing after it. */
static void keep_pace(double *wall_start, double *board_start)
{
    double due = *wall_start + (simulated() - *board_start) / option.speed, late = wall() - due;
    if (late > 0.25) {
        count.slips++;
        *wall_start = wall(), *board_start = simulated();
    } else if (late < 0) {
        struct timespec t = {(time_t)due, (long)((due - (time_t)due) * 1e9)};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, 0);
    }
}

static int run(void)
{
    int state = cpu_Running;
    double wall_start = wall(), board_start = simulated();
    while (!stop && state != cpu_Done && state != cpu_Crashed) {
        if (button) button = 0, reset_board();
        if (to_hold) {
            avr_cycle_count_t n = to_hold < SLICE ? to_hold : SLICE;
            to_hold -= n, held += n;
        } else {
            avr_cycle_count_t end = avr->cycle + SLICE;
            while (avr->cycle < end && state != cpu_Done && state != cpu_Crashed) state = avr_run(avr);
            set_frame_length();
        }
        serve_port();
        if (option.seconds > 0 && simulated() >= option.seconds) break;
        if (option.speed > 0) keep_pace(&wall_start, &board_start);
    }
    return state;
}

static const char *read_options(int argc, char **argv)
{
    static const struct option known[] = {
        {"link", 1, 0, 'l'}, {"adc", 1, 0, 'a'}, {"adc-times", 1, 0, 't'}, {"speed", 1, 0, 'x'},
        {"wait-open", 0, 0, 'w'}, {"reset-on-open", 0, 0, 'r'}, {"hold", 1, 0, 'h'}, {"check-baud", 0, 0, 'b'},
        {"seconds", 1, 0, 's'}, {"low", 1, 0, 'g'}, {0, 0, 0, 0}};
    for (int c; (c = getopt_long(argc, argv, "", known, 0)) != -1;) {
        switch (c) {
        case 'l': option.link = optarg; break;
        case 'a': option.adc = optarg; break;
        case 't': option.adc_times = optarg; break;
        case 'x': option.speed = atof(optarg); break;
        case 'w': option.wait_open = 1; break;
        case 'r': option.reset_on_open = 1; break;
        case 'h': option.hold = atof(optarg); break;
        case 'b': option.check_baud = 1; break;
        case 'g': option.low |= 1 << atoi(optarg); break;
        case 's': option.seconds = atof(optarg); break;
        default: exit(2);
        }
    }
    if (optind + 1 != argc) fail("one firmware file");
    return argv[optind];
}

int main(int argc, char **argv)
{
    char name[64], target[64] = "";
    const char *firmware = read_options(argc, argv);
    prctl(PR_SET_PDEATHSIG, SIGTERM); /* never outlive the test that started it */
    struct sigaction action = {.sa_handler = on_stop};
    sigaction(SIGTERM, &action, 0);
    sigaction(SIGINT, &action, 0);
    action.sa_handler = on_button;
    sigaction(SIGUSR1, &action, 0);
    if (option.adc) read_counts(option.adc);
    if (option.adc_times && !(adc_times = fopen(option.adc_times, "w"))) fail(option.adc_times);
    power_up(firmware);
    make_port(name, sizeof name);
    printf("READY %s\n", name);
    fflush(stdout);
    while (option.wait_open && !stop && !is_open) {
        usleep(500);
        serve_port();
    }
    int state = run();
    while (!stop && is_open && option.seconds > 0) { /* closing the port now would throw unread bytes away */
        serve_port();
        usleep(1000);
    }
    fprintf(stderr, "simulated %.6f s, conversions %llu, out %llu, in %llu, dropped %llu, ", simulated(),
            count.conversions, count.out, count.in, count.dropped);
    fprintf(stderr, "resets %llu, opens %llu, slips %llu\n", count.resets, count.opens, count.slips);
    if (adc_times) fclose(adc_times);
    if (option.link && readlink(option.link, target, sizeof target - 1) > 0 && !strcmp(target, name))
        unlink(option.link);
    avr_terminate(avr);
    return state == cpu_Crashed ? 3 : 0;
}
