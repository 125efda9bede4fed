/* Checks agent.c by the golden pairs and by numbers that are not finite, and times it:
 * cc -O2 agent.c agent_check.c -lm && ./a.out
 * Build it with the flags of your firmware. */
#include "agent.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define COUNT /*@COUNT*/2/*@*/
#define TOLERANCE /*@TOLERANCE*/1e-6F/*@*/

static const int begins[COUNT] = {
    /*@BEGINS*/1, 0/*@*/};
static const float observations[COUNT * RANS_OBSERVATION] = {
    /*@OBSERVATIONS*/1.0F, 1.0F/*@*/};
static const float expected[COUNT * RANS_COMMANDS] = {
    /*@EXPECTED*/0.5F, 0.75F/*@*/};

static int is_shut(const float command[RANS_COMMANDS])
{
    for (int i = 0; i < RANS_COMMANDS; ++i) {
        if (command[i] < 0.0F || command[i] > 0.0F) { return 0; }
    }
    return 1;
}

/* Whether NaN and the infinities are no readings in any column, and a struct without a reset commands nothing. */
static int is_guarded(void)
{
    static const uint32_t wild[3] = {0x7FC00000U, 0x7F800000U, 0xFF800000U};
    rans_agent agent;
    float observation[RANS_OBSERVATION];
    float command[RANS_COMMANDS];
    int guarded = 1;
    for (int i = 0; i < 3 * RANS_OBSERVATION; ++i) {
        memcpy(observation, observations, sizeof observation);
        memcpy(&observation[i % RANS_OBSERVATION], &wild[i / RANS_OBSERVATION], sizeof(float));
        rans_agent_reset(&agent);
        if (rans_agent_act(&agent, observation, command) != RANS_SHUT || !is_shut(command)) { guarded = 0; }
        rans_agent_reset(&agent);
        (void)rans_agent_act(&agent, observations, command);
        if (!(rans_agent_act(&agent, observation, command) & (RANS_HELD | RANS_SHUT))) { guarded = 0; }
    }
    agent.held = INT_MIN;
    if (!(rans_agent_act(&agent, observations, command) & RANS_SHUT) || !is_shut(command)) { guarded = 0; }
    memset(&agent, 0, sizeof agent);
    if (!(rans_agent_act(&agent, observations, command) & RANS_SHUT) || !is_shut(command)) { guarded = 0; }
    return guarded;
}

int main(void)
{
    rans_agent agent;
    float command[RANS_COMMANDS];
    int right = 0;
    double longest = 0.0;
    double whole = 0.0;
    rans_agent_reset(&agent);
    for (int row = 0; row < COUNT; ++row) {
        int same = 1;
        clock_t before;
        double taken;
        if (begins[row]) { rans_agent_reset(&agent); }
        before = clock();
        (void)rans_agent_act(&agent, observations + row * RANS_OBSERVATION, command);
        taken = 1e6 * (double)(clock() - before) / (double)CLOCKS_PER_SEC;
        whole += taken;
        if (taken > longest) { longest = taken; }
        for (int i = 0; i < RANS_COMMANDS; ++i) {
            if (!(fabsf(command[i] - expected[row * RANS_COMMANDS + i]) <= TOLERANCE)) { same = 0; }
        }
        right += same;
    }
    printf("%d of %d golden pairs come out as they should; %.1f us a command, at most %.0f us; "
           "%u bytes of state.\n",
           right, COUNT, whole / COUNT, longest, (unsigned)sizeof(rans_agent));
    if (!is_guarded()) {
        printf("Observations that are not finite, or a struct without a reset, are flown.\n");
        return 1;
    }
    return right != COUNT;
}
