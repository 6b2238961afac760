/* The start and the reset vector of an emulated Cortex-M; printing and files go to the host by semihosting. */
#include <stdint.h>

extern void _start(void);
extern uint32_t __stack[];

static void reset(void)
{
#ifdef __ARM_FP
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: switch the floating-point unit on */
    __asm volatile("dsb\n isb");
#endif
    _start();
}

static void fault(void)
{
    for (;;) { }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
    (void (*)(void))__stack, reset, fault, fault, fault, fault, fault,
};
