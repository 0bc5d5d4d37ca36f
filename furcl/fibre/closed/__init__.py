"""What models share whose scattering function knows no offset h."""
