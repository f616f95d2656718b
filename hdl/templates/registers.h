{% set prefix = name | upper %}
/* Registers of the {{ name }} accelerator, version {{ version }}. Generated; do not edit. */
#ifndef {{ prefix }}_REGISTERS_H
#define {{ prefix }}_REGISTERS_H
{% for register in registers %}

/* {{ register.description }} */
#define {{ prefix }}_{{ register.name }} 0x{{ "%02X" % register.offset }}u
{% for field in register.fields %}
{% set macro = [prefix, register.name, field.name | upper] | join("_") %}
#define {{ macro }}_SHIFT {{ field.low }}u
#define {{ macro }}_MASK 0x{{ "%08X" % field.mask }}u
{% endfor %}
{% endfor %}

#endif /* {{ prefix }}_REGISTERS_H */
