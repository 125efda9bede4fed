/* @TITLE@
 *
 * Control period: @PERIOD@ s. contract.json says everything that an engineer needs to know of this agent.
 *
 * Add agent.c to the sources of your firmware, with -lm (a test is cc -std=c99 agent.c agent_check.c -lm && ./a.out):
 *
 *     #include "agent.h"
 *     static rans_agent agent;                                       // all of its state: no heap
 *     static float observation[RANS_OBSERVATION], command[RANS_COMMANDS];
 *     rans_agent_reset(&agent);                                      // when a flight begins
 *     int status = rans_agent_act(&agent, observation, command);     // every control period; 0: all is well
 *
 * Columns of an observation:
@COLUMNS@
 *
 * Commands:
@ORDER@
 */
#ifndef RANS_AGENT_H
#define RANS_AGENT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RANS_OBSERVATION /*@WIDTH*/1/*@*/
#define RANS_COMMANDS /*@COMMANDS*/1/*@*/
#define RANS_MEMORY /*@MEMORY*/1/*@*/

/* What rans_agent_act returns: a sum of these, 0 where all is well. */
#define RANS_HELD 1      /* the observation was no reading, or repeats under thrust: the last one was held */
#define RANS_SHUT 2      /* no reading is young enough, or the answer is not finite: all commands are 0 */
#define RANS_FORGOTTEN 4 /* the memory was not finite and is forgotten */
#define RANS_UNTRIED 8   /* the agent was not tried with such an observation */
#define RANS_UNREADY 16  /* rans_agent_reset was never called, or the struct was overwritten: all commands are 0 */

#define RANS_PATIENCE /*@PATIENCE*/1/*@*/ /* control periods for which a reading may be held */
/*@STACK*/#define RANS_STACK 1 /* bytes of stack for rans_agent_act, by the compiler's -O2 on a machine;
                        * those of tanhf and its like come on top. Measure yours by -fstack-usage. *//*@*/

typedef struct {
    uint32_t ready; /* a mark of rans_agent_reset */
    float memory[/*@KEPT*/1/*@*/];
    float last[RANS_OBSERVATION];
    int held; /* control periods since a reading */
    int pushed; /* whether the last command pushes or turns the spacecraft */
} rans_agent;

/* Begin an episode: what the agent remembers is forgotten. */
void rans_agent_reset(rans_agent *agent);

/* The commands to an observation, once every control period. An observation with a number that is not finite is no
 * reading, also where the compiler assumes finite numbers (-ffast-math). */
int rans_agent_act(rans_agent *agent, const float observation[RANS_OBSERVATION], float command[RANS_COMMANDS]);

/* The commands and the next memory, of any observation and memory, without a look at ranges. Of an agent without
 * a memory both may be null. */
void rans_agent_answer(const float observation[RANS_OBSERVATION], const float *memory,
                       float command[RANS_COMMANDS], float *after);

#ifdef __cplusplus
}
#endif
#endif
