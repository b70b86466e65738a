"""Values of the field: attitudes, cameras, instants, panoramas, sites. May import no other room but process."""
