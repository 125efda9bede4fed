/* An agent as a unit: rans_agent_act of agent.c.
 *
 * The agent acts once a control period. A step from t to t + h makes it act at every instant k * RANS_PERIOD in
 * [t, t + h), with the inputs that were set before the step; the outputs are its last commands. A master that sets
 * the readings of an instant, steps by one period and then reads the outputs has the commands of that instant.
 */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "agent.h"
#include "agent_fmu.h"
#include "unit.h"

/* Value references: inputs from 0, outputs from RANS_OBSERVATION, then the agent's notes. */
#define NOTES (RANS_OBSERVATION + RANS_COMMANDS)
/* Part of a control period by which an instant may be off through rounding of the master's times. */
#define ROUNDING 1e-6

struct unit {
    rans_agent agent;
    float observation[RANS_OBSERVATION];
    float command[RANS_COMMANDS];
    int notes;        /* what rans_agent_act returned last */
    double begin;     /* time of the first instant, s */
    double decisions; /* instants at which the agent has acted; a whole number */
};

const char *unit_guid(void) { return RANS_GUID; }

void unit_reset(unit *self) {
    memset(self, 0, sizeof *self);
    rans_agent_reset(&self->agent);
}

unit *unit_new(void) {
    unit *self = malloc(sizeof *self);
    if (self != NULL) {
        unit_reset(self);
    }
    return self;
}

void unit_start(unit *self, double time) { self->begin = time; }

const char *unit_initialized(unit *self) {
    (void)self;
    return NULL;
}

int unit_get(const unit *self, unsigned at, double *value) {
    if (at >= NOTES) {
        return 0;
    }
    *value = at < RANS_OBSERVATION ? (double)self->observation[at] : (double)self->command[at - RANS_OBSERVATION];
    return 1;
}

int unit_set(unit *self, unsigned at, double value) {
    if (at >= RANS_OBSERVATION) {
        return 0;
    }
    self->observation[at] = (float)value;
    return 1;
}

int unit_get_integer(const unit *self, unsigned at, int *value) {
    if (at != NOTES) {
        return 0;
    }
    *value = self->notes;
    return 1;
}

const char *unit_step(unit *self, double time, double step) {
    const double end = (time + step - self->begin) / RANS_PERIOD - ROUNDING;
    while (self->decisions < end) {
        self->notes = rans_agent_act(&self->agent, self->observation, self->command);
        self->decisions += 1.0;
    }
    return NULL;
}
