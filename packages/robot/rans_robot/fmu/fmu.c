/* An agent as a functional mock-up unit: FMI 2.0 for co-simulation, around rans_agent_act of agent.c.
 *
 * The types and values below are declared after the FMI 2.0.4 specification (sections 2.1 and 4.2); no header of the
 * standard is part of this file.
 *
 * The agent acts once a control period. A step from t to t + h makes it act at every instant k * RANS_PERIOD in
 * [t, t + h), with the inputs that were set before the step; the outputs are its last commands. A master that sets
 * the readings of an instant, steps by one period and then reads the outputs has the commands of that instant.
 */
#include "fmu_agent.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "agent.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Byte;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef int fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

/* Value references: inputs from 0, outputs from RANS_OBSERVATION, then the agent's notes. */
#define NOTES (RANS_OBSERVATION + RANS_COMMANDS)
/* Part of a control period by which an instant may be off through rounding of the master's times. */
#define ROUNDING 1e-6

typedef struct {
    rans_agent agent;
    float observation[RANS_OBSERVATION];
    float command[RANS_COMMANDS];
    int notes;        /* what rans_agent_act returned last */
    double begin;     /* time of the first instant, s */
    double decisions; /* instants at which the agent has acted; a whole number */
} unit;

static void begin(unit *self, double time) {
    memset(self, 0, sizeof *self);
    self->begin = time;
    rans_agent_reset(&self->agent);
}

EXPORTED const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORTED const char *fmi2GetVersion(void) { return "2.0"; }

EXPORTED fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String names[]) {
    (void)c, (void)on, (void)count, (void)names;
    return fmi2OK;
}

EXPORTED fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                       const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                       fmi2Boolean logging) {
    unit *self;
    (void)name, (void)resources, (void)functions, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, RANS_GUID) != 0) {
        return NULL;
    }
    self = malloc(sizeof *self);
    if (self != NULL) {
        begin(self, 0.0);
    }
    return self;
}

EXPORTED void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORTED fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                        fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((unit *)c)->begin = start;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2Terminate(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2Reset(fmi2Component c) {
    begin(c, 0.0);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference at[], size_t count, fmi2Real value[]) {
    const unit *self = c;
    size_t k;
    for (k = 0; k < count; k++) {
        if (at[k] >= NOTES) {
            return fmi2Error;
        }
        value[k] = at[k] < RANS_OBSERVATION ? (double)self->observation[at[k]]
                                            : (double)self->command[at[k] - RANS_OBSERVATION];
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                const fmi2Real value[]) {
    unit *self = c;
    size_t k;
    for (k = 0; k < count; k++) {
        if (at[k] >= RANS_OBSERVATION) {
            return fmi2Error;
        }
        self->observation[at[k]] = (float)value[k];
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                   fmi2Integer value[]) {
    size_t k;
    for (k = 0; k < count; k++) {
        if (at[k] != NOTES) {
            return fmi2Error;
        }
        value[k] = ((const unit *)c)->notes;
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_return) {
    unit *self = c;
    const double end = (time + step - self->begin) / RANS_PERIOD - ROUNDING;
    (void)no_return;
    if (!(step >= 0.0) || !isfinite(end)) {
        return fmi2Error;
    }
    while (self->decisions < end) {
        self->notes = rans_agent_act(&self->agent, self->observation, self->command);
        self->decisions += 1.0;
    }
    return fmi2OK;
}

/* What this unit has none of: other types of variables, states to save, derivatives, steps that go on. */
#define NO_VALUES(get, set, type)                                                                            \
    EXPORTED fmi2Status get(fmi2Component c, const fmi2ValueReference at[], size_t count, type value[]) {    \
        (void)c, (void)at, (void)value;                                                                      \
        return count ? fmi2Error : fmi2OK;                                                                   \
    }                                                                                                        \
    EXPORTED fmi2Status set(fmi2Component c, const fmi2ValueReference at[], size_t count, const type value[]) { \
        (void)c, (void)at, (void)value;                                                                      \
        return count ? fmi2Error : fmi2OK;                                                                   \
    }

NO_VALUES(fmi2GetBoolean, fmi2SetBoolean, fmi2Boolean)
NO_VALUES(fmi2GetString, fmi2SetString, fmi2String)

EXPORTED fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                   const fmi2Integer value[]) {
    (void)c, (void)at, (void)value;
    return count ? fmi2Error : fmi2OK;
}

EXPORTED fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c, (void)state;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    (void)c, (void)state;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c, (void)state;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state, (void)size;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    (void)c, (void)state, (void)bytes, (void)size;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                            fmi2FMUstate *state) {
    (void)c, (void)bytes, (void)size, (void)state;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                                 const fmi2ValueReference known[], size_t knowns,
                                                 const fmi2Real change[], fmi2Real result[]) {
    (void)c, (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)change, (void)result;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                                const fmi2Integer order[], const fmi2Real value[]) {
    (void)c, (void)at, (void)count, (void)order, (void)value;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                                 const fmi2Integer order[], fmi2Real value[]) {
    (void)c, (void)at, (void)count, (void)order, (void)value;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2CancelStep(fmi2Component c) {
    (void)c;
    return fmi2Error;
}

#define NO_STATUS(name, type)                                                           \
    EXPORTED fmi2Status name(fmi2Component c, const fmi2StatusKind kind, type *value) { \
        (void)c, (void)kind, (void)value;                                               \
        return fmi2Discard;                                                             \
    }

NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetRealStatus, fmi2Real)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetBooleanStatus, fmi2Boolean)
NO_STATUS(fmi2GetStringStatus, fmi2String)
