/* A craft as a unit: rans_craft_move of craft.c, the equations of motion of RANS over a control period.
 *
 * A step lasts one control period or a whole number of them, over which the commands that were set before are held.
 */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "craft.h"
#include "unit.h"

/* Value references: commands from 0, the state at the start, the state, and the mass. */
#define START RANS_COMMANDS
#define STATE (START + RANS_STATE)
#define MASS (STATE + RANS_STATE)
/* Part of a control period by which a step may be off through rounding of the master's times. */
#define ROUNDING 1e-6
/* What the square of a unit quaternion may be off by. */
#define ROUNDED 1e-6

struct unit {
    double command[RANS_COMMANDS];
    double start[RANS_STATE];
    double state[RANS_STATE];
    char wrong[160];
};

const char *unit_guid(void) { return RANS_GUID; }

void unit_reset(unit *self) {
    memset(self, 0, sizeof *self);
    memcpy(self->command, rans_craft_low, sizeof self->command);
    memcpy(self->start, rans_craft_start, sizeof self->start);
    memcpy(self->state, self->start, sizeof self->state);
}

unit *unit_new(void) {
    unit *self = malloc(sizeof *self);
    if (self != NULL) {
        unit_reset(self);
    }
    return self;
}

void unit_start(unit *self, double time) { (void)self, (void)time; }

const char *unit_initialized(unit *self) {
    double square = 0.0;
    int k;
    memcpy(self->state, self->start, sizeof self->state);
    for (k = 0; k < RANS_STATE; k++) {
        /* A comparison with NaN is false. */
        if (!(self->start[k] >= rans_craft_least[k] && self->start[k] <= rans_craft_most[k])) {
            snprintf(self->wrong, sizeof self->wrong, "start_%s is %g, which is outside its range",
                     rans_craft_names[k], self->start[k]);
            return self->wrong;
        }
    }
    for (k = RANS_QUATERNION; k < RANS_QUATERNION_END; k++) {
        square += self->start[k] * self->start[k];
    }
    if (RANS_QUATERNION < RANS_QUATERNION_END && fabs(square - 1.0) > ROUNDED) {
        snprintf(self->wrong, sizeof self->wrong, "start_qw to start_qz have the length %g, and a rotation has 1",
                 sqrt(square));
        return self->wrong;
    }
    return NULL;
}

int unit_get(const unit *self, unsigned at, double *value) {
    if (at > MASS) {
        return 0;
    }
    *value = at < START   ? self->command[at]
             : at < STATE ? self->start[at - START]
             : at < MASS  ? self->state[at - STATE]
                          : rans_craft_mass(self->state);
    return 1;
}

int unit_set(unit *self, unsigned at, double value) {
    if (at >= STATE) {
        return 0;
    }
    if (at < START) {
        self->command[at] = value;
    } else {
        self->start[at - START] = value;
        self->state[at - START] = value;
    }
    return 1;
}

int unit_get_integer(const unit *self, unsigned at, int *value) {
    (void)self, (void)at, (void)value;
    return 0;
}

/* Whether a thruster or wheel takes its command; on/off thrusters take 0 and 1. */
static int takes(int k, double command) {
    const int between = command > rans_craft_low[k] && command < rans_craft_high[k];
    return command >= rans_craft_low[k] && command <= rans_craft_high[k] && !(rans_craft_switches[k] && between);
}

const char *unit_step(unit *self, double time, double step) {
    const double periods = floor(step / RANS_PERIOD + 0.5);
    double after[RANS_STATE];
    double done;
    int k;
    (void)time;
    if (fabs(step / RANS_PERIOD - periods) > ROUNDING * fmax(periods, 1.0)) {
        snprintf(self->wrong, sizeof self->wrong, "a step of %g s is no whole number of control periods of %g s", step,
                 RANS_PERIOD);
        return self->wrong;
    }
    for (k = 0; k < RANS_COMMANDS; k++) {
        if (!takes(k, self->command[k])) {
            snprintf(self->wrong, sizeof self->wrong, "command[%d] is %g, and %s takes %s%g%s%g", k, self->command[k],
                     rans_craft_effectors[k], rans_craft_switches[k] ? "" : "from ", rans_craft_low[k],
                     rans_craft_switches[k] ? " or " : " to ", rans_craft_high[k]);
            return self->wrong;
        }
    }
    for (done = 0.0; done < periods; done += 1.0) {
        rans_craft_move(self->state, self->command, after);
        for (k = 0; k < RANS_STATE; k++) {
            if (!isfinite(after[k])) {
                snprintf(self->wrong, sizeof self->wrong, "%s is no longer finite", rans_craft_names[k]);
                return self->wrong;
            }
        }
        memcpy(self->state, after, sizeof after);
    }
    return NULL;
}
