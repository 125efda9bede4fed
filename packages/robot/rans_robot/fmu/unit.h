/* What a unit of FMI 2.0 is made of: an agent (agent_unit.c). */
#ifndef RANS_UNIT_H
#define RANS_UNIT_H

typedef struct unit unit;

/* Identity, which modelDescription.xml has too. */
const char *unit_guid(void);
/* A unit as after unit_reset, which free() frees; NULL: there is no memory. */
unit *unit_new(void);
/* Everything as at its start. */
void unit_reset(unit *self);
/* The time at which the simulation begins, s. */
void unit_start(unit *self, double time);
/* Called once the start values are set. The sentence that is returned says what is wrong; NULL: nothing. */
const char *unit_initialized(unit *self);
/* Values by their references; 0: there is none, or it cannot be set. */
int unit_get(const unit *self, unsigned at, double *value);
int unit_set(unit *self, unsigned at, double value);
int unit_get_integer(const unit *self, unsigned at, int *value);
/* From a time, s, on for a step, s. Returns as unit_initialized. */
const char *unit_step(unit *self, double time, double step);

#endif
