/* @TITLE@ */
#include "agent.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define READY 0x52414E53U /* "RANS", which memory that was never set is unlikely to hold */

/*@RANGES*/static const float valid_low[RANS_OBSERVATION] = {-1.0F};
static const float valid_high[RANS_OBSERVATION] = {1.0F};
static const float refused_low[RANS_OBSERVATION] = {-9.0F};
static const float refused_high[RANS_OBSERVATION] = {9.0F};
static const float pushes[RANS_COMMANDS * 6] = {1.0F};/*@*/

/*@TABLES*/static const float t_gain[2] = {0.5F, 0.25F};/*@*/

void rans_agent_answer(const float observation[RANS_OBSERVATION], const float *memory,
                       float command[RANS_COMMANDS], float *after)
{
/*@UNUSED*//*@*//*@STEPS*/    command[0] = t_gain[0] * observation[0] + memory[0];
    after[0] = t_gain[1] * observation[0];/*@*/
}

/* By its bits: compilers that assume finite numbers leave out every comparison that only a NaN fails. */
static int is_finite(const float *number)
{
    uint32_t bits;
    memcpy(&bits, number, sizeof bits);
    return (bits & 0x7F800000U) != 0x7F800000U;
}

static void forget(rans_agent *agent)
{
/*@FORGET*/    for (int i = 0; i < RANS_MEMORY; ++i) { agent->memory[i] = 0.0F; }/*@*/
}

/* Whether a command pushes or turns the spacecraft, so that readings cannot stay as they are. */
static int is_pushed(const float command[RANS_COMMANDS])
{
    for (int axis = 0; axis < 6; ++axis) {
        float sum = 0.0F;
        for (int i = 0; i < RANS_COMMANDS; ++i) { sum += pushes[6 * i + axis] * command[i]; }
        if (sum > 1e-6F || sum < -1e-6F) { return 1; }
    }
    return 0;
}

void rans_agent_reset(rans_agent *agent)
{
    forget(agent);
    for (int i = 0; i < RANS_OBSERVATION; ++i) { agent->last[i] = 0.0F; }
    agent->held = RANS_PATIENCE; /* at first there is no reading */
    agent->pushed = 0;
    agent->ready = READY;
}

int rans_agent_act(rans_agent *agent, const float observation[RANS_OBSERVATION], float command[RANS_COMMANDS])
{
    int status = 0;
    int still = agent->pushed && memcmp(agent->last, observation, sizeof agent->last) == 0;
    int fresh = !still;
    int sound = 1;
/*@SCRATCH*/    float after[RANS_MEMORY];
/*@*/    if (agent->ready != READY || agent->held < 0 || agent->held > RANS_PATIENCE + 1) {
        for (int i = 0; i < RANS_COMMANDS; ++i) { command[i] = 0.0F; }
        return RANS_SHUT | RANS_UNREADY;
    }
    for (int i = 0; i < RANS_OBSERVATION; ++i) {
        if (!is_finite(&observation[i]) || observation[i] < refused_low[i] || observation[i] > refused_high[i]) {
            fresh = 0;
        }
    }
    if (fresh) {
        agent->held = 0;
        for (int i = 0; i < RANS_OBSERVATION; ++i) { agent->last[i] = observation[i]; }
    } else if (agent->held <= RANS_PATIENCE) {
        agent->held += 1;
    }
    if (agent->held > RANS_PATIENCE) {
        forget(agent);
        for (int i = 0; i < RANS_COMMANDS; ++i) { command[i] = 0.0F; }
        agent->pushed = still; /* until another reading comes */
        return RANS_SHUT;
    }
    if (!fresh) { status |= RANS_HELD; }
    for (int i = 0; i < RANS_OBSERVATION; ++i) {
        if (agent->last[i] < valid_low[i] || agent->last[i] > valid_high[i]) { status |= RANS_UNTRIED; }
    }
/*@CHECKBEFORE*/    for (int i = 0; i < RANS_MEMORY; ++i) {
        if (!is_finite(&agent->memory[i])) { status |= RANS_FORGOTTEN; }
    }
    if (status & RANS_FORGOTTEN) { forget(agent); }
/*@*/    rans_agent_answer(agent->last, /*@REMEMBERED*/agent->memory/*@*/, command, /*@AFTER*/after/*@*/);
    for (int i = 0; i < RANS_COMMANDS; ++i) {
        if (!is_finite(&command[i])) { sound = 0; }
    }
/*@CHECKAFTER*/    for (int i = 0; i < RANS_MEMORY; ++i) {
        if (!is_finite(&after[i])) { sound = 0; }
    }
/*@*/    agent->pushed = sound && is_pushed(command);
    if (!sound) {
        forget(agent);
        for (int i = 0; i < RANS_COMMANDS; ++i) { command[i] = 0.0F; }
        return status | RANS_SHUT/*@FORGOTTEN*/ | RANS_FORGOTTEN/*@*/;
    }
/*@KEEP*/    for (int i = 0; i < RANS_MEMORY; ++i) { agent->memory[i] = after[i]; }
/*@*/    return status;
}
